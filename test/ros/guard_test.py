#!/usr/bin/env python3
"""The force guard as a node: what reaches the hand, and the zeros that it gets when something stops, or the guard is stopped itself."""
import subprocess
import threading
import time
import unittest

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from pliant.msg import SimState, StepTiming
from std_msgs.msg import Bool


class Guarded(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("guard_test")
        cls.received, cls.silent, cls.absolute, cls.said, cls.playing = [], [], [], {}, True
        publish = lambda name, kind, latch=False: rospy.Publisher(name, kind, queue_size=1, latch=latch)
        cls.pose, cls.wrench = publish("/tissue/PSM1/measured_cp", PoseStamped), publish("/tissue/PSM1/measured_cf", WrenchStamped)
        cls.timing, cls.state = publish("/tissue/timing", StepTiming), publish("/tissue/state", SimState, True)
        cls.following = publish("/MTMR_PSM1/following", Bool, True)
        rospy.Subscriber("/MTMR/body/servo_cf", WrenchStamped, lambda message: cls.received.append((time.time(), message)))
        rospy.Subscriber("/silent/servo_cf", WrenchStamped, cls.silent.append)
        rospy.Subscriber("/MTMR/body/set_cf_orientation_absolute", Bool, cls.absolute.append)
        rospy.Subscriber("/diagnostics", DiagnosticArray, lambda message: cls.said.update({s.name: s.message for s in message.status}))
        cls.state.publish(SimState(state=SimState.RUNNING))
        cls.following.publish(Bool(True))
        threading.Thread(target=cls.play, daemon=True).start()

    @classmethod
    def play(cls):
        while not rospy.is_shutdown():
            try:
                cls.play_once()
            except rospy.ROSException:
                return  # shutting down
            time.sleep(0.01)

    @classmethod
    def play_once(cls):
        if cls.playing:
            now = rospy.Time.now()
            pose, wrench = PoseStamped(), WrenchStamped()
            pose.header.stamp = wrench.header.stamp = now
            pose.header.frame_id = wrench.header.frame_id = "PSM1_base"
            pose.pose.orientation.w = 1
            wrench.wrench.force.z = -4
            cls.pose.publish(pose)
            cls.wrench.publish(wrench)
            timing = StepTiming(error=1e-4)
            timing.header.stamp = now
            cls.timing.publish(timing)

    def wait(self, condition, what, seconds=30):
        end = time.time() + seconds
        while not condition():
            self.assertLess(time.time(), end, what + "; said: %s" % self.said)
            time.sleep(0.01)

    def feels(self, size):
        return bool(self.received) and abs(self.received[-1][1].wrench.force.z - size) < 0.02

    def test_1_a_part_of_the_force_reaches_the_hand(self):
        self.wait(lambda: self.feels(1), "0.25 of 4 N, turned round")
        self.assertEqual(self.received[-1][1].header.frame_id, "PSM1_base")
        self.wait(lambda: self.absolute, "orientation_absolute")
        self.assertTrue(self.absolute[-1].data)
        self.assertEqual(self.silent, [])  # off by default

    def test_2_zeros_and_then_nothing_when_the_teleoperation_lets_go(self):
        self.wait(lambda: self.feels(1), "a force")
        self.following.publish(Bool(False))
        self.wait(lambda: self.feels(0), "zeros")
        self.wait(lambda: time.time() - self.received[-1][0] > 0.5, "silence")
        self.wait(lambda: any("follow" in text for text in self.said.values()), "the reason in diagnostics")
        self.following.publish(Bool(True))
        self.wait(lambda: self.feels(1), "the force again")

    def test_3_zeros_when_the_simulation_stops_sending(self):
        self.wait(lambda: self.feels(1), "a force")
        Guarded.playing = False
        self.wait(lambda: self.feels(0), "zeros")
        Guarded.playing = True
        self.wait(lambda: self.feels(1), "the force again")
        self.state.publish(SimState(state=SimState.PAUSED))
        self.wait(lambda: self.feels(0), "zeros")
        self.state.publish(SimState(state=SimState.RUNNING))
        self.wait(lambda: self.feels(1), "the force again")

    def test_4_a_guard_that_is_stopped_says_zero_last(self):
        self.wait(lambda: self.feels(1), "a force")
        subprocess.check_call(["rosnode", "kill", "/tissue/guard"], stdout=subprocess.DEVNULL)
        self.wait(lambda: self.feels(0), "a last zero")
        last = len(self.received)
        time.sleep(0.5)
        self.assertLessEqual(len(self.received), last + 1)
        self.assertTrue(self.feels(0))


if __name__ == "__main__":
    rostest.rosrun("pliant", "guard", Guarded)
