#!/usr/bin/env python3
"""The Pull tool with a real simulation and a synthetic mouse: a drag moves the tissue under the cursor.

The phantom is seen from the front without perspective: the fixed frame is turned against the tissue's, x left, y up.
"""
import os
import sys
import time
import unittest

import numpy

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
# a stiff spring: the held point stays close to the tip. Busy test machines get more time than a robot does.
PARAMETERS = ["_scan/path:=phantom:48x40x36", "_tools:=mouse", "_tool_max_age:=2.0", "_grasp/stiffness:=100000.0",
              "_parent_frame:=front", "_tissue_pose:=0 0 0 -0.70710678 0 0 0.70710678"]


def front(point):
    """From tissue axes (LPS) to the frame that is looked at: left, superior, anterior."""
    return numpy.array([point[0], point[2], -point[1]])


class Pull(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        view = {"Class": "rviz/TopDownOrtho", "Scale": 700, "X": 0, "Y": 0, "Angle": 0, "Near Clip Distance": 0.01}
        cls.stage = rviz_stage.Stage(rviz_stage.config(DISPLAYS, view, fixed_frame="front", tools=TOOL), 560, 520)
        cls.stage.__enter__()
        cls.stage.start([rviz_stage.program("pliant_node"), "__ns:=tissue"] + PARAMETERS, "node")
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
        cls.stage.wait(lambda: all(s.get_num_connections() > 0 for s in cls.subscribers), what="the topics of tool and tissue")
        cls.stage.wait(lambda: cls.state is not None and cls.contact is not None, what="the simulation")
        cls.rest = cls.state

    @classmethod
    def tearDownClass(cls):
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
        seen = cls.stage.wait_for(lambda p: len(rviz_stage.magenta_centres(p)) == 3 and cls.is_skin(p).sum() > 2000, 120,
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
            # on the surface, which is at the front of the body
            self.assertGreater(self.poses[0].pose.position.z, 0.05)
            for part in numpy.linspace(0, 1, 12):
                self.stage.mouse("mousemove", *numpy.round(start + part * (end - start)).astype(int))
                time.sleep(0.05)

            def held():
                point = self.contact.held_point
                return self.map.pixel(front([point.x, point.y, point.z]))
            way = numpy.linalg.norm(end - start)
            wait(lambda: self.contact.grasped and numpy.linalg.norm(held() - end) < 0.15 * way, what="the tissue under the cursor")
            wait(lambda: abs(self.seen_at(self.poses[-1]) - end).max() < 1.5, what="the tip under the cursor")
            wait(lambda: self.moved().max() > 0.8 * way / self.map.scale, what="the mesh that follows")
            # most of the body stays
            moved = self.moved()
            self.assertLess(numpy.median(moved), 0.2 * moved.max())
            # the picture follows around the cursor
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
        """How far each node is from its place at rest [m]."""
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


if __name__ == "__main__":
    absent = rviz_stage.missing()
    if absent:
        print("skipped: %s not found" % ", ".join(absent))
        sys.exit(rviz_stage.SKIPPED)
    import rospy
    from geometry_msgs.msg import Point, PoseStamped
    from pliant.msg import ContactState, MeshState
    from sensor_msgs.msg import JointState
    from visualization_msgs.msg import Marker
    unittest.main(warnings="ignore")  # rospy's own
