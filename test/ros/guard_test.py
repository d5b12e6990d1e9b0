#!/usr/bin/env python3
"""Test the force guard as a node: the force on the hand, and its zeros when an input stops, or when the guard is
stopped or killed."""
import os
import signal
import socket
import struct
import subprocess
import threading
import time
import unittest
import xmlrpc.client

import rosgraph
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
        cls.received, cls.silent, cls.wrong, cls.absolute, cls.said, cls.levels, cls.playing = (
            [], [], [], [], {}, {}, True)
        publish = lambda name, kind, latch=False: rospy.Publisher(name, kind, queue_size=1, latch=latch)
        cls.pose, cls.wrench = (publish("/tissue/PSM1/measured_cp", PoseStamped),
                                publish("/tissue/PSM1/measured_cf", WrenchStamped))
        cls.timing, cls.state = publish("/tissue/timing", StepTiming), publish("/tissue/state", SimState, True)
        cls.following = publish("/MTMR_PSM1/following", Bool, True)
        rospy.Subscriber("/MTMR/body/servo_cf", WrenchStamped,
                         lambda message: cls.received.append((time.time(), message)))
        rospy.Subscriber("/silent/servo_cf", WrenchStamped, cls.silent.append)
        rospy.Subscriber("/wrong/servo_cf", WrenchStamped, cls.wrong.append)
        rospy.Subscriber("/MTMR/body/set_cf_orientation_absolute", Bool, cls.absolute.append)
        rospy.Subscriber("/diagnostics", DiagnosticArray, cls.hear)
        cls.state.publish(SimState(state=SimState.RUNNING))
        cls.following.publish(Bool(True))
        threading.Thread(target=cls.play, daemon=True).start()

    @classmethod
    def hear(cls, message):
        # the tests wait for a message and then read its level
        cls.levels.update({status.name: status.level for status in message.status})
        cls.said.update({status.name: status.message for status in message.status})

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
        # a new subscriber may still apply the force of an earlier guard
        self.assertEqual(self.first_message().wrench.force.z, 0)
        self.following.publish(Bool(True))
        self.wait(lambda: self.feels(1), "the force again")

    def first_message(self):
        """Return the first message on a separate connection."""
        address = rosgraph.Master("/guard_test").lookupNode("/tissue/guard")
        code, text, (_, host, port) = xmlrpc.client.ServerProxy(address).requestTopic(
            "/console", "/MTMR/body/servo_cf", [["TCPROS"]])
        self.assertEqual(code, 1, text)
        link = socket.create_connection((host, port), timeout=10)
        self.addCleanup(link.close)
        fields = ["callerid=/console", "topic=/MTMR/body/servo_cf", "type=" + WrenchStamped._type,
                  "md5sum=" + WrenchStamped._md5sum]
        header = b"".join(struct.pack("<I", len(field)) + field.encode() for field in fields)
        link.sendall(struct.pack("<I", len(header)) + header)
        stream = link.makefile("rb")
        read = lambda: stream.read(*struct.unpack("<I", stream.read(4)))
        read()  # the guard's own header
        return WrenchStamped().deserialize(read())

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
        before, after = self.next_guard(lambda: subprocess.check_call(["rosnode", "kill", "/tissue/guard"],
                                                                      stdout=subprocess.DEVNULL))
        self.assertEqual(before[-1][1].wrench.force.z, 0)
        self.assertEqual(after[0][1].wrench.force.z, 0)
        self.wait(lambda: self.feels(1), "the force again")

    def next_guard(self, ends):
        """Return the messages of the guard that ends, and the messages of the next guard."""
        begin = len(self.received)
        ends()

        def change():  # a change of the publisher restarts the message counter
            return [i for i in range(max(begin, 1), len(self.received)) if self.received[i][1].header.seq <
                    self.received[i - 1][1].header.seq]
        self.wait(change, "the next guard")
        return self.received[:change()[0]], self.received[change()[0]:]

    def process_of(self, node):
        return xmlrpc.client.ServerProxy(rosgraph.Master("/guard_test").lookupNode(node)).getPid("/guard_test")[2]

    def test_5_the_guard_after_one_that_was_killed_begins_with_zeros(self):
        self.wait(lambda: self.feels(1), "a force")
        process = self.process_of("/tissue/guard")

        def kill():
            os.kill(process, signal.SIGKILL)
            self.following.publish(Bool(False))  # so that the next guard has no other reason to send
        before, after = self.next_guard(kill)
        print("%.2f s without a word" % (after[0][0] - before[-1][0]))
        self.assertAlmostEqual(before[-1][1].wrench.force.z, 1, delta=0.02)  # the force on the hand until now
        first = self.received.index(after[0])
        self.wait(lambda: time.time() - self.received[-1][0] > 0.5, "silence")
        self.assertEqual(set(message.wrench.force.z for _, message in self.received[first:]), {0})
        self.following.publish(Bool(True))
        self.wait(lambda: self.feels(1), "the force again")

    def test_6_a_wrong_parameter_is_told_of_and_no_guard_is_started_over_and_over(self):
        name = "tissue/wrong: force guard"
        self.wait(lambda: "~gain is -1" in self.said.get(name, ""), "the parameter in diagnostics")
        self.assertEqual(self.levels[name], b"\x02" if isinstance(self.levels[name], bytes) else 2)  # an error
        process = self.process_of("/tissue/wrong")
        self.wait(lambda: self.wrong, "zeros")
        self.wait(lambda: self.feels(1), "the other guard's force")  # all is as it should be, but the parameter
        time.sleep(1)
        self.assertEqual(self.process_of("/tissue/wrong"), process)
        self.assertEqual(set(message.wrench.force.z for message in self.wrong), {0})
        rospy.set_param("/tissue/wrong/gain", 0.125)
        subprocess.check_call(["rosnode", "kill", "/tissue/wrong"], stdout=subprocess.DEVNULL)
        self.wait(lambda: abs(self.wrong[-1].wrench.force.z - 0.5) < 0.02, "the next one's force")


if __name__ == "__main__":
    rostest.rosrun("pliant", "guard", Guarded)
