#!/usr/bin/env python3
"""Test a severed organ in rviz: the phantom's liver hangs, the service cuts it, and it falls open. The volume, its
isosurface and the mesh show the deformed voxels, including the open cut. The view is the view of
rviz_pull_test.py.
"""
import os
import sys
import unittest

import numpy

import rviz_stage

VOLUME = """
- Class: pliant/Volume
  Name: volume
  Enabled: true
  Topic: tissue/volume
  Rendering: %s
  Preset: CT abdomen
  Slices: 256
  Slices While Moving: 256
  Automatic: false
  Level: 0
  Window: 400
  Isosurface: -100
  Color Bar: false
  Patient Sides: false
"""
MESH = """
- Class: pliant/Mesh
  Name: mesh
  Enabled: true
  Topology Topic: tissue/mesh/topology
  State Topic: tissue/mesh/state
  Rendering: Surface
  Color By: One Color
  Legend: false
"""
SIGHTS = {"slices": VOLUME % "Slices", "isosurface": VOLUME % "Isosurface", "mesh": MESH}
VIEW = {"Class": "rviz/TopDownOrtho", "Scale": 1800, "X": -0.055, "Y": 0.07, "Angle": 0, "Near Clip Distance": 0.01}
LINE = [(-0.20, -0.20, 0.105), (-0.060, -0.20, 0.105)]  # the first of cut_hang_path.yaml, slightly lower
EMPTY = -100  # [HU] and less: empty


def inner(area):
    """Remove a border of 4 pixels, where pixels and voxels differ."""
    for _ in range(4):
        without = area.copy()
        without[1:] &= area[:-1]
        without[:-1] &= area[1:]
        without[:, 1:] &= area[:, :-1]
        without[:, :-1] &= area[:, 1:]
        area = without
    return area


class Severed(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.stage = rviz_stage.Stage(rviz_stage.config(SIGHTS["slices"], VIEW, fixed_frame="front"), 760, 560)
        cls.stage.__enter__()
        launch = os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "..", "launch")
        cls.stage.start([rviz_stage.program("pliant_node"), "__ns:=tissue", "_scan/path:=phantom:96x80x72",
                         "_scene:=" + launch + "/scenes/cut_hang.yaml",
                         "_warp/margin:=0.05", "_parent_frame:=front",
                         "_tissue_pose:=0 0 0 -0.70710678 0 0 0.70710678"], "node")
        rospy.init_node("rviz_cut_test", disable_signals=True)
        cls.whole = cls.state = None  # stamp of the last whole volume, and last state
        cls.resend = rospy.Publisher("tissue/volume/resend", Empty, queue_size=1)
        cls.subscribers = [rospy.Subscriber("tissue/volume", Volume, cls.take_volume, buff_size=1 << 27),
                           rospy.Subscriber("tissue/mesh/state", MeshState, lambda m: setattr(cls, "state", m),
                                            buff_size=1 << 24)]

    @classmethod
    def tearDownClass(cls):
        for subscriber in cls.subscribers:
            subscriber.unregister()
        cls.stage.close()

    @classmethod
    def take_volume(cls, message):
        """Take a whole volume, or a box of changes."""
        box = message.slope * numpy.frombuffer(message.data,
                                               numpy.int16).reshape(message.size[::-1]) + message.intercept
        if list(message.size) == list(message.full_size):
            o, s = message.origin.position, message.spacing
            cls.origin, cls.spacing = numpy.array([o.x, o.y, o.z]), numpy.array([s.x, s.y, s.z])
            cls.voxels, cls.whole = numpy.array(box), message.header.stamp
        else:
            (i, j, k), size = message.offset, message.size
            cls.voxels[k:k + size[2], j:j + size[1], i:i + size[0]] = box

    def call(self, name, kind, *arguments):
        rospy.wait_for_service("tissue/" + name, 60)
        answer = rospy.ServiceProxy("tissue/" + name, kind)(*arguments)
        self.assertTrue(answer.success, answer.message)
        return answer

    def hold_still(self):
        """Pause, and wait for the whole volume and the nodes of the paused state."""
        self.call("pause", SetBool, True)
        begin = rospy.Time.now()

        def is_held():
            if self.whole > begin:
                return self.state.header.stamp > begin
            self.resend.publish()  # the next volume may have been displayed before
            return False
        self.stage.wait(is_held, what="the volume that is held")

    def silhouette(self):
        """Project the tissue voxels to the picture's pixels."""
        x, y, width, height = self.stage.window()
        left = VIEW["X"] + (numpy.arange(width) + 0.5 - width / 2) / VIEW["Scale"]
        up = VIEW["Y"] - (numpy.arange(height) + 0.5 - height / 2) / VIEW["Scale"]
        seen = (self.voxels > EMPTY).any(axis=1)  # along y, the view direction
        i = numpy.round((left - self.origin[0]) / self.spacing[0]).astype(int)
        k = numpy.round((up - self.origin[2]) / self.spacing[2]).astype(int)
        inside = ((k >= 0) & (k < seen.shape[0]))[:, None] & ((i >= 0) & (i < seen.shape[1]))[None, :]
        return inside & seen[numpy.clip(k, 0, seen.shape[0] - 1)[:, None], numpy.clip(i, 0, seen.shape[1] - 1)[None, :]]

    def assert_seen(self, name, is_open):
        self.stage.load(rviz_stage.config(SIGHTS[name], VIEW, fixed_frame="front"))

        def agrees(picture):
            drawn, wanted = self.stage.view(picture).max(axis=2) > 25, self.silhouette()
            self.assertEqual(drawn.shape, wanted.shape, "rviz's window as it is laid out")
            overlap = (drawn & wanted).sum() / max((drawn | wanted).sum(), 1)
            self.assertLess((inner(wanted) & ~drawn).sum(), 0.02 * wanted.sum(), name + ": what is there")
            # its cubes of 9 mm extend beyond the voxels
            self.assertGreater(overlap, 0.75 if name == "mesh" else 0.85, name)
            if is_open:
                gap = self.gap(wanted)
                self.assertLess((drawn & gap).sum(), 0.05 * gap.sum(), name + ": the open cut")
        try:
            self.stage.agrees(agrees)
        finally:
            if "PLIANT_TEST_PICTURE" in os.environ:
                self.stage.picture("%s.%s.%s.png" % (os.environ["PLIANT_TEST_PICTURE"], name,
                                                     "cut" if is_open else "whole"))

    def test_an_open_cut_is_seen(self):
        self.stage.wait(lambda: self.whole and self.state, what="the volume")
        self.hold_still()
        self.stage.wait(lambda: self.silhouette().sum() > 10000, what="a picture's room for the organ")
        for name in SIGHTS:
            self.assert_seen(name, False)
        first = numpy.array(self.state.nodes).reshape(-1, 3)
        cut = self.call("cut", CutLine, Header(frame_id="tissue"), [Point(*point) for point in LINE],
                        Vector3(0, 0.3, 0))
        self.assertGreater(cut.severed_area, 1e-3)
        self.call("pause", SetBool, False)

        def sinks():
            nodes = numpy.array(self.state.nodes).reshape(-1, 3)[:len(first)]
            return (first[:, 2] - nodes[:, 2]).max() > 0.03
        self.stage.wait(sinks, 120, "what is cut to sink")
        before = [self.state]

        def rests():
            """Compare two states, 1 s or more apart: how far the cut is open must not depend on the machine's load."""
            last, now = before[0], self.state
            if (now.header.stamp - last.header.stamp).to_sec() < 1:
                return False
            before[0] = now
            return numpy.abs(numpy.array(now.nodes) - numpy.array(last.nodes)).max() < 1e-4
        self.stage.wait(rests, 120, "what is cut to rest")
        self.hold_still()
        self.assertGreater(self.gap(self.silhouette()).sum(), 400, "it is open")
        for name in SIGHTS:
            self.assert_seen(name, True)

    def gap(self, seen):
        """Return the empty pixels with tissue above and below in their column."""
        above = numpy.logical_or.accumulate(seen, axis=0)
        below = numpy.logical_or.accumulate(seen[::-1], axis=0)[::-1]
        return inner(above & below & ~seen)


if __name__ == "__main__":
    absent = rviz_stage.missing()
    if absent:
        print("skipped: %s not found" % ", ".join(absent))
        sys.exit(rviz_stage.SKIPPED)
    import rospy
    from geometry_msgs.msg import Point, Vector3
    from pliant.msg import MeshState, Volume
    from pliant.srv import CutLine
    from std_msgs.msg import Empty, Header
    from std_srvs.srv import SetBool
    unittest.main(warnings="ignore")  # warnings of rospy
