#!/usr/bin/env python3
"""Test the mouse in rviz with a real simulation. A drag moves the tissue under the cursor. A click grasps the visible
tissue or shows its material. A marker places the tissue, and a panel's points change the transfer function.

The view shows the phantom from the front without perspective. The fixed frame is rotated against the tissue's frame:
x left, y up.
"""
import os
import sys
import time
import unittest

import numpy
import yaml

import rviz_stage

DISPLAYS = """
- Class: pliant/Volume
  Name: volume
  Enabled: true
  Topic: tissue/volume
  Rendering: Isosurface
  Slices: 128
  Slices While Moving: 128
  Color Bar: false
- Class: rviz/Marker
  Name: markers
  Enabled: true
  Marker Topic: markers
"""
TOOL = """
- Class: pliant/Pull
  Namespace: tissue
"""
# a stiff spring keeps the grasped point close to the tip. Busy test machines get more time than a robot.
PARAMETERS = ["_scan/path:=phantom:96x80x72", "_tools:=mouse", "_tool_max_age:=2.0", "_grasp/stiffness:=100000.0",
              "_parent_frame:=front", "_tissue_pose:=0 0 0 -0.70710678 0 0 0.70710678"]


def front(point):
    """Convert tissue axes (LPS) to the view's frame: left, superior, anterior."""
    return numpy.array([point[0], point[2], -point[1]])


class Pull(unittest.TestCase):
    @classmethod
    def begin(cls):
        view = {"Class": "rviz/TopDownOrtho", "Scale": 700, "X": 0, "Y": 0, "Angle": 0, "Near Clip Distance": 0.01}
        cls.stage = rviz_stage.Stage(rviz_stage.config(DISPLAYS, view, fixed_frame="front", tools=TOOL), 760, 560,
                                     tells_rows=True)
        cls.stage.__enter__()
        cls.stage.start([rviz_stage.program("pliant_node"), "__ns:=tissue", "_registration:=" + cls.stage.folder +
                         "/registration.yaml"] + PARAMETERS, "node")
        rospy.init_node("rviz_pull_test", disable_signals=True)
        cls.poses, cls.jaws = [], []
        cls.contact = cls.state = cls.rest = None

        def take_state(message):
            cls.state = numpy.array(message.nodes).reshape(-1, 3)
        cls.subscribers = [
            rospy.Subscriber("tissue/mouse/measured_cp", PoseStamped, cls.poses.append),
            rospy.Subscriber("tissue/mouse/jaw/measured_js", JointState, lambda m: cls.jaws.append(m.position[0])),
            rospy.Subscriber("tissue/mouse/contact", ContactState, lambda m: setattr(cls, "contact", m)),
            rospy.Subscriber("tissue/mesh/state", MeshState, take_state)]
        cls.calibrate()
        cls.stage.wait(lambda: all(s.get_num_connections() > 0 for s in cls.subscribers),
                       what="the topics of tool and tissue")
        cls.stage.wait(lambda: cls.state is not None and cls.contact is not None, what="the simulation")
        cls.rest = cls.state

    @classmethod
    def end(cls):
        if "PLIANT_TEST_PICTURE" in os.environ:
            cls.stage.picture(os.environ["PLIANT_TEST_PICTURE"])
        rospy.signal_shutdown("done")
        cls.stage.__exit__(None, None, None)

    @classmethod
    def calibrate(cls):
        places = numpy.array([[-0.3, -0.28], [0.3, -0.28], [-0.3, 0.28]])
        cls.markers = rospy.Publisher("markers", Marker, queue_size=10, latch=True)
        message = Marker(type=Marker.CUBE_LIST, ns="corners")
        message.header.frame_id = "front"
        message.pose.orientation.w = message.color.a = message.color.r = message.color.b = 1
        message.scale.x = message.scale.y = message.scale.z = 0.02
        message.points = [Point(x, y, 0) for x, y in places]
        cls.markers.publish(message)
        seen = cls.stage.wait_for(lambda p: len(rviz_stage.magenta_centres(p)) == 3 and cls.is_skin(p).sum() > 2000,
                                  120,
                                  "three magenta markers and the phantom's skin")
        cls.map = rviz_stage.Map(places, seen)

    @staticmethod
    def is_skin(picture):
        red, green, blue = (picture[:, :, c].astype(int) for c in range(3))
        return (red > green + 8) & (green > blue + 4)

    def seen_at(self, pose):
        self.assertEqual(pose.header.frame_id, "front")
        return self.map.pixel([pose.pose.position.x, pose.pose.position.y])

    def test_a_drag_moves_the_tissue_under_the_cursor(self):
        start = numpy.round(self.map.pixel([0.02, 0.03])).astype(int)
        end = start + [18, -22]
        before = self.stage.picture()
        wait = self.stage.wait
        try:
            self.stage.mouse("mousemove", *start, "mousedown", 1)
            wait(lambda: self.contact.grasped and self.poses and self.jaws, what="the grasp")
            numpy.testing.assert_allclose(self.seen_at(self.poses[0]), start, atol=1.5)
            self.assertGreater(self.jaws[0], 0.2, "the jaw comes open")
            wait(lambda: self.jaws[-1] < 0.05, what="a closed jaw")
            # on the surface, at the front of the body
            self.assertGreater(self.poses[0].pose.position.z, 0.05)
            for part in numpy.linspace(0, 1, 12):
                self.stage.mouse("mousemove", *numpy.round(start + part * (end - start)).astype(int))
                time.sleep(0.05)

            def held():
                point = self.contact.held_point
                return self.map.pixel(front([point.x, point.y, point.z]))
            way = numpy.linalg.norm(end - start)
            wait(lambda: self.contact.grasped and numpy.linalg.norm(held() - end) < 0.15 * way,
                 what="the tissue under the cursor")
            wait(lambda: abs(self.seen_at(self.poses[-1]) - end).max() < 1.5, what="the tip under the cursor")
            wait(lambda: self.moved().max() > 0.8 * way / self.map.scale, what="the mesh that follows")
            # most of the body stays
            moved = self.moved()
            self.assertLess(numpy.median(moved), 0.2 * moved.max())
            # the image follows around the cursor
            self.stage.wait_for(lambda p: self.difference(before, p, end) > 8, what="the picture of the pulled tissue")
            if "PLIANT_TEST_PICTURE" in os.environ:
                self.stage.picture(os.environ["PLIANT_TEST_PICTURE"] + ".pulled.png")
        finally:
            self.stage.mouse("mouseup", 1)
        wait(lambda: not self.contact.grasped, what="the release")
        wait(lambda: self.jaws[-1] > 0.2, what="an open jaw")
        wait(lambda: self.moved().max() < 0.002, what="the tissue at rest")
        wait(lambda: not self.contact.present, what="the tool gone")

    def moved(self):
        """Return the distance of each node from its rest position [m]."""
        return numpy.linalg.norm(self.state - self.rest, axis=1)

    @staticmethod
    def difference(before, after, at):
        x, y = at
        part = numpy.s_[y - 15:y + 16, x - 15:x + 16]
        return abs(before[part].astype(int) - after[part]).mean()

    def test_nothing_is_taken_hold_of_beside_the_body(self):
        self.stage.wait(lambda: not self.contact.present, what="no tool")
        start = rospy.Time.now()
        beside = numpy.round(self.map.pixel([0.27, 0.2])).astype(int)
        self.assertFalse(self.is_skin(self.stage.picture())[beside[1], beside[0]])
        self.stage.mouse("mousemove", *beside, "mousedown", 1)
        time.sleep(2)
        self.stage.mouse("mousemove", *(beside + [10, 10]))
        time.sleep(0.5)
        self.stage.mouse("mouseup", 1)
        time.sleep(0.5)
        self.assertFalse([pose for pose in self.poses if pose.header.stamp > start], "no poses")
        self.assertFalse(self.contact.grasped)


LOOK = """
- Class: pliant/Volume
  Name: volume
  Enabled: true
  Topic: tissue/volume
  Rendering: Slices
  Preset: CT abdomen
  Slices: 128
  Slices While Moving: 128
  Color Bar: false
  Patient Sides: %s
  Fit View: true
- Class: pliant/Mesh
  Name: mesh
  Enabled: true
  Topology Topic: tissue/mesh/topology
  State Topic: tissue/mesh/state
  Rendering: Wireframe
  Opacity: 0
  Legend: false
%s- Class: rviz/InteractiveMarkers
  Name: registration
  Enabled: true
  Update Topic: tissue/registration/update
"""
TOOLS = """
- Class: pliant/Pull
  Namespace: tissue
- Class: pliant/Material
  Namespace: tissue
"""
PANELS = """Panels:
  - Class: rviz/Tool Properties
    Name: Tool Properties
    Expanded: [/Material1]
    Splitter Ratio: 0.5
  - Class: pliant/TransferFunction
    Name: Transfer Function
"""


class Seen(unittest.TestCase):
    """The phantom as in the demo: half transparent, from the front, with an automatic view."""

    @classmethod
    def setUpClass(cls):
        cls.stage = Pull.stage
        # far too small, and off-centre
        cls.view = {"Class": "rviz/TopDownOrtho", "Scale": 60, "X": 1, "Y": 0.5, "Angle": 0, "Near Clip Distance": 0.01}
        cls.load("false")

    @classmethod
    def load(cls, sides, more="", scalar=""):
        text = rviz_stage.config(LOOK % (sides, "  Scalar: %s\n" % scalar if scalar else "") + more, cls.view,
                                 fixed_frame="front", tools=TOOLS)
        text = text.replace("Panels: []\n", PANELS).replace("Hide Left Dock: true", "Hide Left Dock: false")
        cls.stage.load(text)

    def body(self, picture):
        """Return the rows and columns of the 3-D view that are not background."""
        view = self.stage.view(picture)
        return numpy.argwhere(view.max(axis=2) > 40), view.shape

    def pixel(self, point):
        """Return the pixel of a point in the fixed frame, from rviz's own view settings."""
        view = self.stage.saved()["Views"]["Current"]
        x, y, width, height = self.stage.window()
        return numpy.round([x + width / 2 + (point[0] - view["X"]) * view["Scale"],
                            y + height / 2 - (point[1] - view["Y"]) * view["Scale"]]).astype(int)

    def test_0_the_view_fits_and_letters_tell_the_sides(self):
        def fits(picture):
            of_it, (height, width, _) = self.body(picture)
            self.assertGreater(len(of_it), 0, "something is seen")
            (top, left), (bottom, right) = of_it.min(axis=0), of_it.max(axis=0)
            self.assertGreater(max((bottom - top) / height, (right - left) / width), 0.6, "it fills the view")
            self.assertGreater(min(top, left, height - 1 - bottom, width - 1 - right), 0, "all of it is in view")
        self.stage.agrees(fits)
        without = self.stage.still().astype(int)
        self.load("true")

        def lettered(picture):
            fits(picture)
            rows, columns = numpy.argwhere((picture.min(axis=2) > 200) & (without.max(axis=2) < 40)).T
            height, width = picture.shape[:2]
            for there, name in ((columns < 0.3 * width, "right"), (columns > 0.5 * width, "left"),
                                (rows < 0.4 * height, "superior"), (rows > 0.6 * height, "inferior")):
                self.assertGreater(there.sum(), 15, "white letters on the side that is " + name)
        self.stage.agrees(lettered)
        if "PLIANT_TEST_PICTURE" in os.environ:
            self.stage.picture(os.environ["PLIANT_TEST_PICTURE"] + ".letters.png")

    def choose(self, key):
        """Choose a tool by its key in the 3-D view."""
        x, y, width, height = self.stage.window()
        self.stage.mouse("mousemove", x + width // 2, y + height - 5, "key", key)

    def value_at(self, point):
        """Return the value of the last published volume at the nearest voxel [HU]."""
        volume = self.volume
        voxel = numpy.round((numpy.array(point) - self.origin) / self.spacing).astype(int)
        return volume[tuple(voxel[::-1])]

    def take_volume(self, message):
        if list(message.size) != list(message.full_size):
            return
        o, s = message.origin.position, message.spacing
        self.origin, self.spacing = numpy.array([o.x, o.y, o.z]), numpy.array([s.x, s.y, s.z])
        self.volume = message.slope * numpy.frombuffer(message.data,
                                                       numpy.int16).reshape(message.size[::-1]) + message.intercept

    def liver(self):
        """Return a pixel inside the visible liver: dark red, in a wide patch."""
        view = self.stage.view(self.stage.still()).astype(float)
        red = (view[:, :, 0] > 60) & (view[:, :, 0] > 1.7 * view[:, :, 1]) & (view[:, :, 0] < 190)
        x, y, width, height = self.stage.window()
        best = max(((red[j - 8:j + 9, i - 8:i + 9].mean(), i, j) for j in range(20, height - 20, 4)
                    for i in range(20, width - 20, 4)))
        self.assertGreater(best[0], 0.6, "the liver is seen")
        return numpy.array([x + best[1], y + best[2]])

    def test_1_what_is_seen_is_taken_hold_of(self):
        self.volume = None
        reader = rospy.Subscriber("tissue/volume", Volume, self.take_volume)
        self.stage.wait(lambda: self.volume is not None, what="the volume")
        at = self.liver()
        self.choose("u")
        del Pull.poses[:]
        try:
            self.stage.mouse("mousemove", *at, "mousedown", 1)
            self.stage.wait(lambda: Pull.contact.grasped, what="the grasp")
            held = Pull.contact.held_point
            self.assertGreater(self.value_at([held.x, held.y, held.z]), 60,
                               "not the skin, which lies before it and is faint")
        finally:
            self.stage.mouse("mouseup", 1)
            reader.unregister()
        self.stage.wait(lambda: not Pull.contact.present, what="the tool gone")

    def test_2_the_number_of_the_mesh_is_chosen_while_it_runs(self):
        names = []
        reader = rospy.Subscriber("tissue/mesh/state", MeshState, lambda m: names.append(m.scalar_name))
        self.stage.wait(lambda: names, what="a state")
        self.assertEqual(names[-1], "")
        self.load("false", "", "von_mises")
        self.stage.wait(lambda: names[-1] == "von_mises", what="the number that the display was set to")
        reader.unregister()

    def drag(self, start, by):
        """Drag slowly from one pixel to another."""
        self.stage.mouse("mousemove", *start)
        time.sleep(0.3)
        self.stage.mouse("mousedown", 1)
        for part in numpy.linspace(0, 1, 8):
            self.stage.mouse("mousemove", *numpy.round(numpy.array(start) + part * numpy.array(by)).astype(int))
            time.sleep(0.05)
        self.stage.mouse("mouseup", 1)

    def test_3_a_point_of_the_transfer_function_follows_the_mouse(self):
        def corners(picture):
            """Return the panel's top, left, bottom and right, or False without a panel."""
            there = numpy.argwhere((picture == [32, 32, 36]).all(axis=2))
            return len(there) > 2000 and (*there.min(axis=0), *(there.max(axis=0) + 1))

        def shows_handle(picture, at):
            """Whether a point's white circle is drawn at a pixel."""
            x, y = numpy.round(at).astype(int)
            return (picture[y - 7:y + 8, x - 7:x + 8].min(axis=2) > 200).sum() > 12

        def shows_held_point(picture):
            """Whether the value of a held point is written between the limits of the axis."""
            _, left, bottom, right = corners(picture)
            third = (right - left) // 3
            return (picture[bottom - 20:bottom, left + third:right - third].min(axis=2) > 120).sum() > 20

        def is_ready():
            """Whether the panel shows the preset's skin: position 0.17, opacity 0.1, drawn at its square root. A panel
            that has not read the display's function yet shows no points, and its size can still change."""
            self.before = self.stage.still()
            if not corners(self.before):
                return False
            top, left, bottom, right = corners(self.before)
            self.height = numpy.sqrt(0.1) * (bottom - top - 38)
            self.skin = numpy.array([left + 10 + 0.17 * (right - left - 20), bottom - 28 - self.height])
            return shows_handle(self.before, self.skin) and not shows_held_point(self.before)
        self.stage.wait(is_ready, what="the points in the panel")
        end = self.skin + [0, self.height]
        try:
            self.stage.mouse("mousemove", *numpy.round(self.skin).astype(int), "mousedown", 1)
            self.stage.wait_for(shows_held_point, what="the held point")
            for part in numpy.linspace(0, 1, 8):  # to opacity 0, and 3 pixels beyond
                self.stage.mouse("mousemove", *numpy.round(self.skin + part * (end + [0, 3] - self.skin)).astype(int))
                time.sleep(0.05)
            self.stage.wait_for(lambda p: shows_handle(p, end), what="the point under the cursor")
        finally:
            self.stage.mouse("mouseup", 1)
        points = self.stage.wait(lambda: self.stage.saved()["Displays"][0]["Points"], what="points of its own")
        at, *_, opacity = [float(number) for number in points.split(";")[1].split(",")]
        self.assertAlmostEqual(at, 0.17, delta=0.03)
        self.assertLess(opacity, 0.002)
        before = self.stage.view(self.before).astype(int)
        self.stage.wait_for(lambda p: (abs(self.stage.view(p).astype(int) - before).max(axis=2) > 10).mean() > 0.02,
                            what="the picture without skin")

    def test_4_a_click_tells_the_material_and_a_number_changes_it(self):
        session = []
        reader = rospy.Subscriber("tissue/session", Session, session.append)
        self.stage.wait(lambda: session, what="the session")
        before = yaml.safe_load(session[-1].materials)["materials"]
        liver = self.liver()
        self.choose("a")
        self.stage.mouse("mousemove", *liver)

        def told(name):
            return self.stage.rows().get("Material/" + name, (None, ""))[1]

        def click():
            """Click again until the new tool has received the session."""
            time.sleep(1)
            self.stage.mouse("click", 1)
            time.sleep(1)
            return told("Material")
        clicked = self.stage.wait(click, what="the material")
        self.assertIn(clicked, ("organ", "soft_tissue"), "the one that is seen")
        chosen = [material for material in before if material["name"] == clicked][0]
        for row, key in (("Young's Modulus", "young_modulus"), ("Poisson Ratio", "poisson_ratio"),
                         ("Density", "density")):
            self.assertAlmostEqual(float(told(row)), chosen[key], delta=1e-5 * chosen[key])
        place, _ = self.stage.rows()["Material/Young's Modulus"]
        self.stage.mouse("mousemove", *place, "click", "--repeat", 2, "--delay", 60, 1)
        self.stage.mouse("key", "ctrl+a", "type", "12345")
        self.stage.mouse("key", "Return")
        self.stage.wait(lambda: "12345" in session[-1].materials, what="the material in the simulation")
        after = yaml.safe_load(session[-1].materials)["materials"]
        self.assertEqual([(a, b) for a, b in zip(after, before) if a != b],
                         [(dict(chosen, young_modulus=12345), chosen)])
        self.stage.wait(lambda: told("Young's Modulus") == "12345", what="the number in the panel")
        reader.unregister()

    def test_5_the_tissue_is_dragged_to_where_it_lies(self):
        self.stage.start([rviz_stage.program("registration_marker"), "__ns:=tissue", "_parent_frame:=front"],
                         "registration")
        self.view.update({"Scale": 500, "X": 0, "Y": 0})
        text = rviz_stage.config(LOOK.replace("Enabled: true", "Enabled: false", 2) % ("false", ""), self.view,
                                 fixed_frame="front")
        self.stage.load(text)
        frames = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(frames)

        def place():
            at = frames.lookup_transform("front", "tissue", rospy.Time(0)).transform
            return numpy.array([at.translation.x, at.translation.y, at.translation.z, at.rotation.x, at.rotation.y,
                                at.rotation.z, at.rotation.w])
        self.stage.wait(lambda: frames.can_transform("front", "tissue", rospy.Time(0)), what="where it lies")
        before = place()

        def arrow(picture):
            """Return the rightmost red pixel: the arrow along x."""
            red = numpy.argwhere((picture[:, :, 0] > 120) & (picture[:, :, 1:].max(axis=2) < 80))
            return len(red) > 100 and red[red[:, 1] > red[:, 1].max() - 8].mean(axis=0)[::-1]
        start = arrow(self.stage.wait_for(lambda p: arrow(p) is not False, what="the marker"))
        self.drag(start, [40, 0])
        self.stage.wait(lambda: abs(place()[0] - before[0] - 40 / 500) < 0.008, what="the tissue that follows")
        numpy.testing.assert_allclose(place()[1:], before[1:], atol=1e-3)
        with open(self.stage.folder + "/registration.yaml") as text:
            stored = text.read()
        self.assertIn("parent_frame: front", stored)
        numbers = [float(number) for number in stored.split("tissue_pose: ")[1].split()]
        numpy.testing.assert_allclose(numbers, place(), atol=1e-3)
        listener.unregister()


def setUpModule():
    Pull.begin()


def tearDownModule():
    Pull.end()


if __name__ == "__main__":
    absent = rviz_stage.missing()
    if absent:
        print("skipped: %s not found" % ", ".join(absent))
        sys.exit(rviz_stage.SKIPPED)
    import rospy
    import tf2_ros
    from geometry_msgs.msg import Point, PoseStamped
    from pliant.msg import ContactState, MeshState, Session, Volume
    from sensor_msgs.msg import JointState
    from visualization_msgs.msg import Marker
    unittest.main(warnings="ignore")  # warnings of rospy
