#!/usr/bin/env python3
"""Test the launch file for a real robot with a simulated robot (sim_robot): it grasps and pulls, and the robot's
faults do no harm."""
import os
import pty
import subprocess
import sys
import time
import unittest

import roslib.packages
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, PoseStamped, WrenchStamped
from pliant.srv import Register
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from visualization_msgs.msg import InteractiveMarkerFeedback

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from node_client import Latest, Node, call, wait_for  # noqa: E402

BEHIND = {"silent": "old", "invalid": "stamp 0", "frozen": "old", "nan": "finite", "unknown_frame": "nowhere",
          "ahead": "ahead", "behind": "old",
          "disabled": "the arm is DISABLED", "not_homed": "the arm is not homed"}


def in_arm(place):
    """Convert to the arm's frame, whose origin is 0.2 above the tissue's origin."""
    message = PoseStamped()
    message.pose.position = Point(place[0], place[1], place[2] - 0.2)
    message.pose.orientation.w = 1
    return message


def arrived(pose, place):
    """Return whether the arm has reached its goal. A grasp on the way there would pull for the rest of the way, and
    might slip."""
    if not pose.message:
        return False
    there, goal = pose.message.pose.position, in_arm(place).pose.position
    return abs(there.x - goal.x) + abs(there.y - goal.y) + abs(there.z - goal.z) < 1e-4


def jaw(closed):
    return JointState(position=[0.0 if closed else 0.6])


def close_jaws(node, jaws, seconds):
    """Close the jaws until they hold. On a busy machine the tool may be absent for a moment, so the node misses the
    open jaw."""
    def holds():
        jaws.publish(jaw(False))
        time.sleep(seconds)
        jaws.publish(jaw(True))
        time.sleep(seconds)
        return node.contact.fresh().grasped
    wait_for(holds, "a hold")


class RobotTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("robot_test")
        cls.node = Node("PSM1")
        cls.diagnostics = Latest("/diagnostics", DiagnosticArray)
        cls.pose = Latest("/PSM1/measured_cp", PoseStamped)
        cls.forces = []
        rospy.Subscriber("/tissue/PSM1/measured_cf", WrenchStamped,
                         lambda message: cls.forces.append(message.wrench.force), queue_size=100)
        publish = lambda topic, kind: rospy.Publisher("/PSM1/" + topic, kind, queue_size=1, latch=True)
        cls.servo, cls.jaw, cls.fault = (publish("servo_cp", PoseStamped), publish("jaw/servo_jp", JointState),
                                         publish("fault", String))
        cls.node.wait_until_running()
        wait_for(lambda: cls.node.contact.fresh().present, "the arm", 60)

    def go(self, place):
        self.servo.publish(in_arm(place))

    def close(self, closed):
        self.jaw.publish(jaw(closed))

    def take_hold(self):
        self.fault.publish("none")
        self.close(False)
        inside = self.node.front()
        self.go(inside)
        wait_for(lambda: arrived(self.pose, inside), "the arm to be there")
        wait_for(lambda: self.node.contact.fresh().touching, "the tip in the tissue")
        wait_for(lambda: not self.node.contact.fresh().grasped, "the jaw to open")
        close_jaws(self.node, self.jaw, 0.2)
        return inside

    def why(self):
        statuses = self.diagnostics.message.status if self.diagnostics.message else []
        return " ".join(status.message for status in statuses if status.name.endswith("tool PSM1"))

    def test_a_pull_is_felt_and_bounded(self):
        inside = self.take_hold()
        del self.forces[:]
        self.go([inside[0], inside[1] - 0.004, inside[2]])
        wait_for(lambda: any(abs(force.y) > 0.05 for force in self.forces), "a force")
        self.go([inside[0], inside[1] - 0.15, inside[2]])  # slip is 5 N
        wait_for(lambda: not self.node.contact.fresh().grasped, "the grip to slip")
        self.assertLess(max((f.x ** 2 + f.y ** 2 + f.z ** 2) ** 0.5 for f in self.forces), 5.5)

    def test_what_goes_wrong_lets_go_and_is_told(self):
        for fault, words in BEHIND.items():
            self.take_hold()
            self.fault.publish(fault)
            wait_for(lambda: not self.node.contact.fresh().present, "no tool: " + fault)
            wait_for(lambda: words in self.why(), "the reason %r" % words)
            wait_for(lambda: (self.forces[-1].x, self.forces[-1].y, self.forces[-1].z) == (0, 0, 0),
                     "no force: " + fault)
        self.take_hold()

    def test_an_arm_that_pauses_keeps_what_it_holds(self):
        inside = self.take_hold()
        self.go([inside[0], inside[1] - 0.004, inside[2]])
        wait_for(lambda: self.forces and abs(self.forces[-1].y) > 0.05, "a force")
        self.fault.publish("paused")
        time.sleep(1)
        self.assertTrue(self.node.contact.fresh().grasped)
        self.assertGreater(abs(self.forces[-1].y), 0.05)
        self.fault.publish("none")

    def other_robot(self, namespace, arm, prefix):
        """Test a robot whose poses, jaws and frames the launch file specifies: it grasps and pulls."""
        node, force = Node(arm, namespace), Latest(namespace + arm + "/measured_cf", WrenchStamped)
        servo, jaws = (rospy.Publisher("%s/%s/%s" % (prefix, arm, topic), kind, queue_size=1, latch=True)
                       for topic, kind in (("servo_cp", PoseStamped), ("jaw/servo_jp", JointState)))
        node.wait_until_running()
        inside = node.front()
        jaws.publish(jaw(False))
        servo.publish(in_arm(inside))
        pose = Latest("%s/%s/measured_cp" % (prefix, arm), PoseStamped)
        wait_for(lambda: arrived(pose, inside), "the arm to be there")
        wait_for(lambda: node.contact.fresh().touching, "the tip in the tissue")
        close_jaws(node, jaws, 0.5)
        servo.publish(in_arm([inside[0], inside[1] - 0.004, inside[2]]))
        wait_for(lambda: force.fresh().wrench.force.y < -0.02, "a force")
        jaws.publish(jaw(False))
        wait_for(lambda: not node.contact.fresh().grasped, "the jaw to open")

    def test_a_jaw_that_is_told_what_to_do_is_enough_for_ambf(self):
        self.other_robot("/ambf/", "psm1", "/CRTK")

    def test_a_raven_has_its_jaws_elsewhere(self):
        self.other_robot("/raven/", "arm2", "")

    def test_a_robot_without_one_by_keyboard_and_by_the_marker(self):
        keys, terminal = pty.openpty()
        self.addCleanup(os.close, keys)
        command = [roslib.packages.find_node("pliant", "sim_robot")[0], "__name:=other", "_arms:=PSM3", "_camera:=ECM",
                   "_setup:=0.05 0 0", "_keyboard:=true"]
        robot = subprocess.Popen(command, stdin=terminal)
        os.close(terminal)
        rospy.set_param("/marker/start", [0, 0, -0.1])
        marker = subprocess.Popen([roslib.packages.find_node("pliant", "marker_tool")[0], "__name:=marker",
                                   "_tool:=PSM3", "_frame:=PSM3_base",
                                   "PSM3/measured_cp:=/PSM3/servo_cp", "PSM3/jaw/measured_js:=/PSM3/jaw/servo_jp"])
        pose, local, jaws, state = (Latest("/PSM3/" + topic, kind) for topic, kind in (
            ("measured_cp", PoseStamped), ("local/measured_cp", PoseStamped), ("jaw/measured_js", JointState),
            ("operating_state", rospy.AnyMsg)))
        for process in (robot, marker):
            self.addCleanup(process.wait)
            self.addCleanup(process.kill)
        # dragged to its final position: the marker sends it repeatedly
        drag = rospy.Publisher("/PSM3/drag/feedback", InteractiveMarkerFeedback, queue_size=1)
        wait_for(lambda: drag.get_num_connections() and pose.message and local.message and jaws.message
                 and state.message, "the robot and its marker")
        feedback = InteractiveMarkerFeedback(marker_name="PSM3", event_type=InteractiveMarkerFeedback.POSE_UPDATE)
        feedback.header.frame_id = "PSM3_base"
        feedback.pose = in_arm((0.02, 0.01, 0.15)).pose
        drag.publish(feedback)
        wait_for(lambda: abs(pose.message.pose.position.x - 0.02) < 1e-6, "the arm where the marker is")
        # the topics are independent, so their newest poses may have different times
        wait_for(lambda: abs(local.message.pose.position.x + 0.03) < 1e-6, "the pose in the arm's own frame")
        self.assertEqual((pose.message.header.frame_id, local.message.header.frame_id), ("ECM", "PSM3_base"))
        wait_for(lambda: jaws.message.position[0] > 0.2, "an open jaw")
        marker.terminate()
        marker.wait()
        before = pose.message.pose.position.x
        os.write(keys, b"dd ")
        wait_for(lambda: abs(pose.message.pose.position.x - before - 0.004) < 1e-6, "two steps of 2 mm")
        wait_for(lambda: jaws.message.position[0] < 0.05, "the jaw to close")

    def test_a_teleport_is_no_pull(self):
        self.take_hold()
        del self.forces[:]
        self.fault.publish("teleport")
        wait_for(lambda: not self.node.contact.fresh().grasped, "the grip to be lost")
        self.fault.publish("none")
        self.assertLess(max([(f.x ** 2 + f.y ** 2 + f.z ** 2) ** 0.5 for f in self.forces] + [0]), 5.5)

    def test_the_tissue_lies_where_points_say(self):
        landmarks = [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)]
        room = [Point(x + 0.01, y, z - 0.2) for x, y, z in landmarks]
        answer = call("register", Register, Header(frame_id="PSM1_base"), [Point(*p) for p in landmarks], room, 0)
        self.assertTrue(answer.success, answer.message)
        self.assertLess(answer.error, 1e-9)
        self.assertAlmostEqual(answer.pose.position.x, 0.01)
        self.assertAlmostEqual(answer.pose.position.z, -0.2)
        answer = call("register", Register, Header(frame_id="PSM1_base"), [Point(*p) for p in landmarks[:2]], room[:2],
                      0)
        self.assertFalse(answer.success)
        self.assertIn("three", answer.message)
        back = [Point(x, y, z - 0.2) for x, y, z in landmarks]
        self.assertTrue(call("register", Register, Header(frame_id="PSM1_base"), [Point(*p) for p in landmarks], back,
                             0).success)


if __name__ == "__main__":
    rostest.rosrun("pliant", "robot", RobotTest)
