#!/usr/bin/env python3
"""Test simulated time. The node reports a clock that has not started. After a jump back, it removes tools, sets
forces to zero and continues. If the clock stands still, grasps stay, except for an arm or a jaw that has been
silent for long."""
import os
import re
import sys
import threading
import time
import unittest

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rosgraph_msgs.msg import Clock

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from node_client import Latest, Node, Tool, wait_for  # noqa: E402


class ClockTest(unittest.TestCase):
    def run_clock(self):
        """Advance by a fixed step per turn, for any real duration: on a busy machine everything is slow, but nothing
        is late."""
        ticks = 0
        while not rospy.is_shutdown():
            ticks += self.clock_runs
            if not self.clock_runs:
                time.sleep(0.005)
                continue
            try:
                self.clock.publish(Clock(rospy.Time.from_sec(self.start + 0.005 * ticks)))
            except rospy.ROSException:
                return  # shutting down
            time.sleep(0.005)

    def test_jump_back(self):
        self.start, self.clock_runs = 1000.0, True
        rospy.init_node("clock_test")
        self.clock = rospy.Publisher("/clock", Clock, queue_size=1)
        diagnostics = Latest("/diagnostics", DiagnosticArray)
        stands_still = re.compile("time stands still.*/clock")
        wait_for(lambda: diagnostics.message and any(stands_still.search(status.message)
                                                     for status in diagnostics.message.status),
                 "a word on the clock that nobody sends")
        diagnostics.close()
        threading.Thread(target=self.run_clock, daemon=True).start()
        node, tool = Node(), Tool("grasper", "tissue")
        force = Latest("grasper/measured_cf", WrenchStamped)
        node.wait_until_running()
        point = node.front()
        tool.appear(point)
        wait_for(lambda: node.contact.fresh().touching, "the tool to touch")
        tool.take_hold(node.contact)
        tool.position = list(point - [0, 0.01, 0])
        wait_for(lambda: force.fresh().wrench.force.y < -0.1, "a force")

        self.start = 0.0
        wait_for(lambda: rospy.get_time() < 900, "the new time here")
        for topic in (force, node.contact):  # stamps before the jump are later than all new ones
            wait_for(lambda: topic.message.header.stamp.to_sec() < 900, topic.topic + " of the new time")
        self.assertFalse(node.contact.fresh().grasped)
        wait_for(lambda: force.fresh().wrench.force.y == 0, "no force")
        # the same tool with new stamps is present again, and grasps when it closes again
        wait_for(lambda: node.contact.fresh().present, "the tool to be back")
        self.assertFalse(node.contact.fresh().grasped)
        tool.take_hold(node.contact)

        tool.position = list(point - [0, 0.02, 0])
        wait_for(lambda: force.fresh().wrench.force.y < -0.1, "a force")
        self.clock_runs = False
        time.sleep(4)
        self.assertLess(force.message.wrench.force.y, -0.1, "of an arm that goes on sending")
        before = rospy.get_time()  # from here on no stamp indicates new data
        tool.is_on = False
        time.sleep(1)
        self.assertLess(force.message.wrench.force.y, -0.1, "of a simulator that pauses")
        self.assertTrue(node.contact.message.grasped)
        tool.is_on, tool.with_jaw = True, False
        wait_for(lambda: force.message.wrench.force.y == 0, "no force of a silent jaw")
        wait_for(lambda: not node.contact.message.grasped, "the jaw of which nothing is known to let go")
        self.assertTrue(node.contact.message.present)
        tool.position, tool.with_jaw = list(point), True
        wait_for(lambda: node.contact.message.touching, "the tool to touch")
        tool.take_hold(node.contact)
        tool.position = list(point - [0, 0.02, 0])
        wait_for(lambda: force.message.wrench.force.y < -0.1, "a force")
        tool.is_on = False
        wait_for(lambda: force.message.wrench.force.y == 0, "no force of a silent arm")
        wait_for(lambda: not node.contact.message.grasped, "the arm to be gone")
        self.assertEqual(rospy.get_time(), before, "time stands still")
        diagnostics = Latest("/diagnostics", DiagnosticArray)
        wait_for(lambda: diagnostics.message and any("time stands still, and no pose" in status.message
                                                     for status in diagnostics.message.status), "the reason")
        step = node.mesh.fresh().step
        wait_for(lambda: node.mesh.message.step > step + 10, "steps by the machine's clock")


if __name__ == "__main__":
    rostest.rosrun("pliant", "clock", ClockTest)
