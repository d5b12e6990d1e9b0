#!/usr/bin/env python3
"""Test the pictures of the volume and mesh displays: known volumes at known positions, seen from above, pixel by pixel.

One rviz shows a stage along -z without perspective. Each test has a separate spot, 0.4 m from the others. Three
magenta markers calibrate pixels to metres.
"""
import os
import sys
import time
import unittest

import numpy

import rviz_stage

X_STEP, Y_STEP = 0.4, 0.4
PLAIN = """
- Class: pliant/Volume
  Name: %(name)s
  Enabled: true
  Topic: %(name)s/volume
  Rendering: %(rendering)s
  Preset: Grey
  Automatic: false
  Level: 191.5
  Window: 127
  Isosurface: 127.5
  Opacity: 1
  Shading: 0
  Slices: 96
  Slices While Moving: 96
  Color Bar: false
  Patient Sides: false
  Texture Memory: %(memory)d
"""
CLIPPED = """  Clip Plane:
    Value: true
    Normal: {X: 1, Y: 0, Z: 0}
    Point: {X: 0.02, Y: 0, Z: 0}
"""
CLIPPED_BOX = """  Clip Box:
    Value: true
    From: {X: 0, Y: 0.5, Z: 0}
    To: {X: 1, Y: 1, Z: 1}
"""
CUT_AWAY = """  Cut Away:
    Value: true
    From: {X: 0.5, Y: 0, Z: 0.5}
    To: {X: 1, Y: 1, Z: 1}
"""
MESH = """
- Class: pliant/Mesh
  Name: %(name)s
  Enabled: true
  Topology Topic: %(name)s/topology
  State Topic: %(name)s/state
  Color By: One Color
  Color: 255; 255; 255
  Edges: false
  Legend: false
"""
MARKERS = """
- Class: rviz/Marker
  Name: markers
  Enabled: true
  Marker Topic: markers
- Class: rviz/InteractiveMarkers
  Name: interactive
  Enabled: true
  Update Topic: handle/update
"""


def volume_display(name, rendering="Slices", memory=1024):
    return PLAIN % dict(name=name, rendering=rendering, memory=memory)


def spot(column, row):
    return numpy.array([column * X_STEP, row * Y_STEP, 0.0])


def quaternion(axis, angle):
    axis = numpy.asarray(axis, float) / numpy.linalg.norm(axis)
    return numpy.append(axis * numpy.sin(angle / 2), numpy.cos(angle / 2))


def rotation(q):
    x, y, z, w = q
    return numpy.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def volume(voxels, spacing, origin, orientation=(0, 0, 0, 1), frame="stage", sequence=1, flipped=False, offset=None,
           full=None, since=0):
    """Return voxels[k, j, i] of uint8, int16 or float32 as a message."""
    message = Volume()
    message.header.frame_id = frame
    message.scan_id = "test"
    message.sequence = sequence
    message.since = since
    message.size = list(voxels.shape[::-1])
    message.full_size = list(full) if full else message.size
    message.offset = list(offset) if offset else [0, 0, 0]
    message.origin.position.x, message.origin.position.y, message.origin.position.z = origin
    q = message.origin.orientation
    q.x, q.y, q.z, q.w = orientation
    message.flipped = flipped
    message.spacing.x, message.spacing.y, message.spacing.z = spacing
    message.encoding = {"uint8": 1, "int16": 2, "float32": 3}[voxels.dtype.name]
    message.slope = 1
    message.data = numpy.ascontiguousarray(voxels).tobytes()
    return message


# grey window: values below its low end are invisible
LOW, HIGH = 128, 255


class Pictures(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        displays = MARKERS
        for name in ["placed", "ordered", "bricks", "oblique", "broken", "around", "thin", "lossy"]:
            displays += volume_display(name)
        displays += volume_display("clipped") + CLIPPED + volume_display("boxed") + CLIPPED_BOX
        displays += volume_display("away") + CUT_AWAY + volume_display("hollow", "Isosurface") + CUT_AWAY
        displays += volume_display("surface", "Isosurface") + volume_display("large", memory=1)
        displays += MESH % dict(name="mesh")
        view = {"Class": "rviz/TopDownOrtho", "Scale": 380, "X": 1.5 * X_STEP, "Y": X_STEP, "Angle": 0,
                "Near Clip Distance": 0.01}
        cls.stage = rviz_stage.Stage(rviz_stage.config(displays, view, fixed_frame="stage"), 640, 560)
        cls.stage.__enter__()
        rospy.init_node("rviz_pictures_test", disable_signals=True)
        cls.log = []
        cls.listener = rospy.Subscriber("/rosout", Log, lambda line: cls.log.append(line.msg), queue_size=100)
        cls.publishers = {}
        cls.frames = []
        cls.transforms = tf2_ros.StaticTransformBroadcaster()
        cls.calibrate()

    @classmethod
    def tearDownClass(cls):
        if "PLIANT_TEST_PICTURE" in os.environ:  # a file for inspection
            cls.stage.picture(os.environ["PLIANT_TEST_PICTURE"])
        rospy.signal_shutdown("done")
        cls.stage.__exit__(None, None, None)

    @classmethod
    def publish(cls, topic, message):
        if topic not in cls.publishers:
            cls.publishers[topic] = rospy.Publisher(topic, type(message), queue_size=10, latch=True)
            cls.stage.wait(lambda: cls.publishers[topic].get_num_connections() > 0, what="a reader of " + topic)
        cls.publishers[topic].publish(message)

    @classmethod
    def marker(cls, number, centre, size, colour):
        message = Marker(type=Marker.CUBE, id=number, ns="test")
        message.header.frame_id = "stage"
        message.pose.orientation.w = 1
        message.pose.position.x, message.pose.position.y, message.pose.position.z = centre
        message.scale.x, message.scale.y, message.scale.z = size
        message.color.r, message.color.g, message.color.b = colour
        message.color.a = 1
        cls.publish("markers", message)

    @classmethod
    def transform(cls, child, translation, orientation):
        message = TransformStamped()
        message.header.frame_id = "stage"
        message.header.stamp = rospy.Time.now()
        message.child_frame_id = child
        t, q = message.transform.translation, message.transform.rotation
        t.x, t.y, t.z = translation
        q.x, q.y, q.z, q.w = orientation
        # the topic is latched, so its last message must contain all of them
        cls.frames.append(message)
        cls.transforms.sendTransform(cls.frames)

    @classmethod
    def calibrate(cls):
        """Find the map from metres to pixels by three markers."""
        cls.transform("moved", spot(0, 0) + [0.05, -0.02, 0.1], quaternion([0, 0, 1], numpy.pi / 2))
        cls.transform("aside", [0, Y_STEP, 0], [0, 0, 0, 1])
        places = numpy.array([[-0.15, -0.15], [3 * X_STEP + 0.15, -0.15], [-0.15, 2 * Y_STEP + 0.15]])
        for n, place in enumerate(places):
            cls.marker(n, [place[0], place[1], 0], [0.03, 0.03, 0.03], [1, 0, 1])

        picture = cls.stage.wait_for(lambda p: len(rviz_stage.magenta_centres(p)) == 3, 60, "the three magenta markers")
        cls.map = rviz_stage.Map(places, picture)
        cls.scale = cls.map.scale

    def pixel(self, point):
        return self.map.pixel(point)

    def grey(self, picture, point):
        """Return the mean brightness of 3 x 3 pixels around a point of the stage."""
        x, y = numpy.round(self.pixel(point)).astype(int)
        return picture[y - 1:y + 2, x - 1:x + 2].mean()

    def colour(self, picture, point):
        x, y = numpy.round(self.pixel(point)).astype(int)
        return picture[y - 1:y + 2, x - 1:x + 2].reshape(-1, 3).mean(axis=0)

    def bright(self, picture, column, row, above=100):
        """Return the bounding box (low, high) [m] of the bright pixels around a spot, and their mask."""
        middle = spot(column, row)
        corners = numpy.array([self.pixel(middle - [0.19, 0.19, 0]), self.pixel(middle + [0.19, 0.19, 0])])
        (x0, y0), (x1, y1) = corners.min(axis=0).astype(int), corners.max(axis=0).astype(int)
        mask = picture[y0:y1, x0:x1].min(axis=2) > above
        if not mask.any():
            return None, mask
        rows, columns = numpy.argwhere(mask).T
        edges = (numpy.array([[x0 + columns.min(), y0 + rows.max() + 1], [x0 + columns.max() + 1, y0 + rows.min()]]) -
                 0.5)
        return self.map.place(edges), mask

    def assert_box(self, picture, column, row, low, high, pixels=2):
        box, _ = self.bright(picture, column, row)
        self.assertIsNotNone(box, "nothing bright at spot %d, %d" % (column, row))
        numpy.testing.assert_allclose(box, [low, high], atol=pixels / self.scale)

    def test_a_bright_box_is_where_tf_says(self):
        voxels = numpy.zeros((10, 40, 60), numpy.uint8)
        voxels[2:8, 10:20, 30:50] = 255
        # frame "moved" is at the spot + (50, -20) mm, rotated by a quarter turn: its x is the stage's y
        self.publish("placed/volume", volume(voxels, [0.002, 0.003, 0.004], [-0.06, -0.04, 0], frame="moved"))
        # Voxels 30 to 50 along i: x from -0.06 + 29.5 * 2 mm to 49.5; 10 to 20 along j: y from -0.04 + 9.5 * 3 mm to
        # 19.5. Interpolation blurs an edge over one voxel around its middle.
        x = numpy.array([-0.06 + 29.5 * 0.002, -0.06 + 49.5 * 0.002])
        y = numpy.array([-0.04 + 9.5 * 0.003, -0.04 + 19.5 * 0.003])
        low, high = [0.05 - y[1], -0.02 + x[0]], [0.05 - y[0], -0.02 + x[1]]
        self.stage.agrees(lambda picture: self.assert_box(picture, 0, 0, low, high))

    def test_opaque_objects_hide_and_are_hidden(self):
        voxels = numpy.zeros((20, 32, 32), numpy.uint8)
        voxels[5:15, 4:28, 4:28] = 255
        at = spot(1, 0)
        self.publish("ordered/volume", volume(voxels, [0.005] * 3, at + [-0.08, -0.08, -0.05]))
        self.marker(10, at + [-0.03, 0, 0.10], [0.03, 0.03, 0.01], [0, 1, 0])  # in front
        self.marker(11, at + [0.03, 0, -0.10], [0.03, 0.03, 0.01], [0, 0, 1])  # behind
        self.marker(12, at + [0.0, 0.085, -0.10], [0.02, 0.04, 0.01], [0, 0, 1])  # behind, and half outside

        def check(picture):
            front, behind, beside = (self.colour(picture, at + offset)
                                     for offset in ([-0.03, 0, 0], [0.03, 0, 0], [0, 0.095, 0]))
            self.assertGreater(front[1], 100)
            self.assertLess(max(front[0], front[2]), 40, "the marker in front hides the volume")
            self.assertGreater(behind.min(), 150, "the volume hides the marker behind it")
            self.assertGreater(beside[2], 100, "beside the volume the marker is seen")
            self.assertLess(beside[0], 40)
        self.stage.agrees(check)

    def test_a_marker_inside_shows_through_what_is_transparent(self):
        # 1 % of the window: half of the light passes through the upper half of it
        voxels = numpy.full((20, 32, 32), LOW + 0.01 * (HIGH - LOW), numpy.float32)
        at = spot(2, 0)
        self.publish("thin/volume", volume(voxels, [0.005] * 3, at + [-0.08, -0.08, -0.05]))
        self.marker(13, at, [0.03, 0.03, 0.01], [1, 0, 0])
        self.marker(16, at + [0.09, 0, 0], [0.015, 0.03, 0.01], [1, 0, 0])  # outside it

        def check(picture):
            inside, beside = self.colour(picture, at), self.colour(picture, at + [0.09, 0, 0])
            self.assertGreater(min(inside[0], beside[0]), 60, "the markers")
            # 50 mm, in units of 1/256 of its diagonal of 247 mm, each of which transmits 99 %
            self.assertAlmostEqual(inside[0] / beside[0], 0.99 ** (0.05 / (0.247 / 256)), delta=0.06)
            self.assertLess(inside[1], 20)
        self.stage.agrees(check)

    def test_the_clip_plane_cuts(self):
        voxels = numpy.full((10, 30, 30), 255, numpy.int16)
        at = spot(3, 0)
        # the plane is x = 20 mm in the volume's frame
        self.transform("clip_frame", at, [0, 0, 0, 1])
        self.publish("clipped/volume", volume(voxels, [0.005] * 3, [-0.075, -0.075, 0], frame="clip_frame"))
        half = 0.0025  # the volume extends half a voxel beyond its outermost centres
        self.stage.agrees(lambda picture: self.assert_box(picture, 3, 0, at[:2] + [0.02, -0.075 - half],
                                                          at[:2] + [0.07 + half, 0.07 + half]))

    def test_the_clip_box_cuts(self):
        voxels = numpy.full((10, 30, 30), 255, numpy.uint8)
        at = spot(3, 1)
        self.publish("boxed/volume", volume(voxels, [0.005] * 3, at + [-0.0725, -0.0725, 0]))
        self.stage.agrees(lambda picture: self.assert_box(picture, 3, 1, at[:2] + [-0.075, 0], at[:2] + [0.075, 0.075]))

    def test_what_is_cut_away_is_not_seen_but_what_is_behind_it(self):
        voxels = numpy.full((10, 24, 24), 255, numpy.uint8)
        voxels[:6] = 200
        at = spot(1, 2)
        for name, x in (("away", -0.09), ("hollow", 0.09)):
            self.publish(name + "/volume", volume(voxels, [0.005] * 3, at + [x - 0.0575, -0.0575, -0.0225]))

        def check(picture):
            for x in (-0.09, 0.09):
                self.assertGreater(self.grey(picture, at + [x - 0.03, 0, 0]), 235, "the upper half, where it is left")
                behind = self.grey(picture, at + [x + 0.03, 0, 0])
                self.assertGreater(behind, 120, "what is below is seen where the upper half is cut away")
                self.assertLess(behind, 180, "the upper half is cut away")
        self.stage.agrees(check)

    def test_one_brick_changes_only_its_region(self):
        voxels = numpy.zeros((32, 48, 48), numpy.int16)
        voxels[:, 4:44, 4:44] = 190
        at, spacing = spot(0, 1), 0.005
        origin = at + [-0.12, -0.12, -0.05]
        self.publish("bricks/volume", volume(voxels, [spacing] * 3, origin))
        self.stage.wait_for(lambda p: self.grey(p, at) > 20, what="the volume")
        before = self.stage.still().astype(int)
        brick = numpy.full((16, 16, 16), 255, numpy.int16)
        self.publish("bricks/volume", volume(brick, [spacing] * 3, origin, sequence=2, offset=[16, 16, 16],
                                             full=[48, 48, 32]))
        middle = origin + numpy.array([23.5, 23.5, 0]) * spacing
        x, y, width, height = self.stage.window()  # without the status bar with the frame rate
        # interpolation extends one voxel beyond the brick
        corners = numpy.array([self.pixel(origin + spacing * numpy.array([15.0, 15.0, 0])),
                               self.pixel(origin + spacing * numpy.array([32.0, 32.0, 0]))])

        def check(picture):
            self.assertGreater(self.grey(picture, middle), 200)
            differs = abs(picture.astype(int) - before).max(axis=2)
            changed = numpy.argwhere(differs[y:y + height, x:x + width] > 3) + [y, x]
            self.assertGreaterEqual(changed[:, 1].min(), corners[:, 0].min() - 1.5)
            self.assertLessEqual(changed[:, 1].max(), corners[:, 0].max() + 1.5)
            self.assertGreaterEqual(changed[:, 0].min(), corners[:, 1].min() - 1.5)
            self.assertLessEqual(changed[:, 0].max(), corners[:, 1].max() + 1.5)
            self.assertGreater(len(changed), 0.8 * (16 * spacing * self.scale) ** 2)
        self.stage.agrees(check)

    def test_a_lost_box_is_asked_for(self):
        """After a gap in the sequence, the display subscribes again and receives a whole volume."""
        connected = []

        class Listener(rospy.SubscribeListener):
            def peer_subscribe(self, *_):
                connected.append(time.time())
        publisher = rospy.Publisher("lossy/volume", Volume, subscriber_listener=Listener(), queue_size=10)
        voxels, origin = numpy.zeros((8, 8, 8), numpy.uint8), [0, 0, 0]
        self.stage.wait(lambda: connected, what="the display that subscribes")
        publisher.publish(volume(voxels, [0.002] * 3, origin))
        publisher.publish(volume(voxels, [0.002] * 3, origin, sequence=2))
        time.sleep(4)
        self.assertEqual(len(connected), 1, "nothing was lost")
        publisher.publish(volume(voxels[:2, :2, :2], [0.002] * 3, origin, sequence=4, offset=[1, 1, 1], full=[8, 8, 8],
                                 since=3))
        self.stage.wait(lambda: len(connected) == 2, what="the display that subscribes anew")
        # a reset, which rviz also does when time jumps back, discards everything; it must be sent again. The button is
        # at the lower left.
        self.stage.mouse("mousemove", 33, self.stage.height - 14, "click", 1)
        self.stage.wait(lambda: len(connected) == 3, what="the display that subscribes after a reset")

    def test_an_oblique_volume_lands_where_its_mesh_lands(self):
        size, spacing, flipped = numpy.array([30, 20, 16]), numpy.array([0.004, 0.006, 0.005]), True
        q = quaternion([1, 2, 0.7], 0.8)
        axes = rotation(q) @ numpy.diag([1, 1, -1.0 if flipped else 1])
        at = spot(1, 1)
        origin = at - axes @ (spacing * (size - 1) / 2)
        self.publish("oblique/volume", volume(numpy.full(size[::-1], 255, numpy.float32), spacing, origin, q,
                                              flipped=flipped))
        # its box as a mesh, in a frame one spot further along y
        corners = numpy.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)]) * size - 0.5
        nodes = origin + (corners * spacing) @ axes.T
        message = MeshTopology(scan_id="test", revision=1)
        message.header.frame_id = "aside"
        message.rest_nodes = nodes.ravel()
        message.rest_parent = range(8)
        message.tetrahedra = numpy.array([[0, 3, 5, 6], [1, 0, 3, 5], [2, 3, 0, 6], [4, 5, 0, 6], [7, 3, 5, 6]]).ravel()
        message.triangles = numpy.array([[0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5], [0, 1, 5], [0, 5, 4],
                                         [2, 6, 7], [2, 7, 3], [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6]]).ravel()
        self.publish("mesh/topology", message)
        state = MeshState(revision=1)
        state.header.frame_id = "aside"
        state.nodes = nodes.ravel()
        self.publish("mesh/state", state)
        # of another topology: must not be drawn
        stray = MeshState(revision=2)
        stray.header.frame_id = "aside"
        stray.nodes = nodes.ravel() + 0.1

        def check(picture):
            of_volume, mask = self.bright(picture, 1, 1, above=15)
            of_mesh, mesh_mask = self.bright(picture, 1, 2, above=15)
            self.assertFalse(of_volume is None or of_mesh is None, "both are seen")
            corners = nodes[:, :2]
            numpy.testing.assert_allclose(of_volume, [corners.min(axis=0), corners.max(axis=0)], atol=2 / self.scale)
            numpy.testing.assert_allclose(of_mesh - [0, Y_STEP], of_volume, atol=2 / self.scale)
            # and pixel by pixel, except at the rim
            height, width = min(mask.shape[0], mesh_mask.shape[0]), min(mask.shape[1], mesh_mask.shape[1])
            differ = (mask[:height, :width] != mesh_mask[:height, :width]).sum()
            self.assertLess(differ, 0.06 * mesh_mask.sum())
        self.stage.agrees(check)
        self.publish("mesh/state", stray)
        time.sleep(1.5)
        self.stage.agrees(check)

    def test_the_isosurface_is_where_the_value_is(self):
        k, j, i = numpy.mgrid[0:40, 0:40, 0:40]
        at, spacing, radius = spot(2, 1), 0.004, 0.06
        distance = numpy.sqrt((k - 19.5) ** 2 + (j - 19.5) ** 2 + (i - 19.5) ** 2) * spacing
        values = 127.5 + (radius - distance) * 1000  # 127.5 at the radius
        self.publish("surface/volume", volume(values.astype(numpy.float32), [spacing] * 3, at - 19.5 * spacing))
        # a marker that extends out of the top, and one inside
        self.marker(14, at + [0.01, 0, radius - 0.005], [0.015, 0.015, 0.03], [0, 1, 0])
        self.marker(15, at + [-0.02, 0, 0], [0.02, 0.02, 0.02], [0, 0, 1])
        low, high = self.pixel(at - [0.19, 0.19, 0]), self.pixel(at + [0.19, 0.19, 0])
        x0, x1, y0, y1 = int(low[0]), int(high[0]), int(high[1]), int(low[1])

        def check(picture):
            ball = picture[y0:y1, x0:x1].max(axis=2) > 20
            area = ball.sum() / self.scale ** 2
            self.assertAlmostEqual(area, numpy.pi * radius ** 2, delta=0.03 * numpy.pi * radius ** 2)
            poking, inside = self.colour(picture, at + [0.01, 0, 0]), self.colour(picture, at + [-0.02, 0, 0])
            self.assertGreater(poking[1], poking[0] + 60, "what pokes out is seen")
            self.assertGreater(inside[0], inside[2], "what is inside is hidden by the surface")
        self.stage.agrees(check)

    def test_malformed_volumes_are_refused_with_a_reason(self):
        at = spot(0, 2)
        good = numpy.full((8, 20, 20), 255, numpy.uint8)
        nan = float("nan")

        def broken(change):
            message = volume(good, [0.005] * 3, at - [0.05, 0.05, 0])
            change(message)
            return message

        def set_size(m): m.full_size = m.size = [20, 20, 9]
        def cut_data(m): m.data = m.data[:-1]
        def no_data(m): m.data = b""
        def zero_spacing(m): m.spacing.y = 0
        def nan_spacing(m): m.spacing.z = nan
        def nan_pose(m): m.origin.position.x = nan
        def zero_quaternion(m): m.origin.orientation.w = 0
        def encoding(m): m.encoding = 9
        def outside(m): m.offset = [1, 0, 0]
        def huge(m): m.full_size = m.size = [2 ** 32 - 1] * 3
        def empty(m): m.full_size = m.size = [0, 0, 0]
        cases = [(set_size, "does not match the data"), (cut_data, "does not match the data"),
                 (no_data, "does not match the data"),
                 (zero_spacing, "spacing"), (nan_spacing, "spacing"), (nan_pose, "pose"),
                 (zero_quaternion, "quaternion"),
                 (encoding, "unknown encoding 9"), (outside, "leaves the volume"), (huge, "does not match the data"),
                 (empty, "empty")]
        def tells(reason):
            self.stage.wait(lambda: any(reason in line for line in self.log), what="the reason: " + reason)
        for number, (change, reason) in enumerate(cases):
            # the log contains each new reason once, so an unused reason is caused first
            self.publish("broken/volume", broken(lambda m: setattr(m, "encoding", 100 + number)))
            tells("unknown encoding %d" % (100 + number))
            del self.log[:]
            self.publish("broken/volume", broken(change))
            tells(reason)
        self.assertIsNone(self.bright(self.stage.picture(), 0, 2)[0], "nothing of it is drawn")
        self.publish("broken/volume", broken(lambda m: None))
        self.stage.wait_for(lambda p: self.bright(p, 0, 2)[0] is not None, what="a good volume after the bad ones")

    def test_too_large_is_shown_subsampled(self):
        at, size = spot(3, 2), 128
        voxels = numpy.zeros((size, size, size), numpy.int16)  # 4 MiB, one is allowed
        voxels[:, 32:96, 32:64] = 255
        self.publish("large/volume", volume(voxels, [0.001] * 3, at - 0.064))
        # every second voxel: edges to within one of them
        self.stage.agrees(lambda picture: self.assert_box(picture, 3, 2, at[:2] + [-0.0325, -0.0325],
                                                          at[:2] + [-0.0005, 0.0315], pixels=2.5))

    def test_a_marker_inside_gets_the_mouse(self):
        at = spot(2, 2)
        voxels = numpy.full((20, 20, 20), 255, numpy.uint8)  # opaque: the marker is invisible
        self.publish("around/volume", volume(voxels, [0.005] * 3, at - 0.0475))
        got = []
        server = InteractiveMarkerServer("handle")
        handle = InteractiveMarker(name="handle", scale=0.05)
        handle.header.frame_id = "stage"
        handle.pose.position.x, handle.pose.position.y, handle.pose.position.z = at
        handle.pose.orientation.w = 1
        box = Marker(type=Marker.CUBE)
        box.scale.x = box.scale.y = box.scale.z = 0.03
        box.color.r = box.color.a = 1
        control = InteractiveMarkerControl(name="press", interaction_mode=InteractiveMarkerControl.BUTTON,
                                           always_visible=True)
        control.markers.append(box)
        handle.controls.append(control)
        server.insert(handle, lambda feedback: got.append(feedback.event_type))
        server.applyChanges()
        self.stage.wait_for(lambda p: self.grey(p, at) > 200, what="the volume around the marker")
        x, y = numpy.round(self.pixel(at)).astype(int)

        def clicked():
            self.stage.mouse("mousemove", x - 3, y)
            time.sleep(0.3)
            self.stage.mouse("mousemove", x, y)
            time.sleep(0.5)
            self.stage.mouse("click", 1)
            time.sleep(0.5)
            return InteractiveMarkerFeedback.BUTTON_CLICK in got
        self.stage.wait(clicked, what="the click on the marker")


if __name__ == "__main__":
    absent = rviz_stage.missing()
    if absent:
        print("skipped: %s not found" % ", ".join(absent))
        sys.exit(rviz_stage.SKIPPED)
    import rospy
    import tf2_ros
    from geometry_msgs.msg import TransformStamped
    from interactive_markers.interactive_marker_server import InteractiveMarkerServer
    from pliant.msg import MeshState, MeshTopology, Volume
    from rosgraph_msgs.msg import Log
    from visualization_msgs.msg import InteractiveMarker, InteractiveMarkerControl, InteractiveMarkerFeedback, Marker
    unittest.main(warnings="ignore")  # warnings of rospy
