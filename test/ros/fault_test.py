#!/usr/bin/env python3
"""What goes wrong at the start: a scan that is missing can be mended by load_scan, a wrong parameter ends the node."""
import os
import subprocess
import sys
import unittest

import roslib.packages
import rospy
import rostest
from pliant.msg import SimState
from pliant.srv import LoadScan, RecomputeHomogenization
from std_srvs.srv import SetBool, Trigger

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from node_client import NAMESPACE, Node, wait_for  # noqa: E402


def call(name, kind, *arguments):
    rospy.wait_for_service(NAMESPACE + name, 30)
    return rospy.ServiceProxy(NAMESPACE + name, kind)(*arguments)


class FaultTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("fault_test")

    def test_missing_scan_is_a_fault_that_load_scan_mends(self):
        node = Node()
        wait_for(lambda: node.state.message and node.state.message.state == SimState.FAULT, "FAULT")
        wait_for(lambda: not node.state.message.is_busy, "the state to be idle")
        self.assertIn("/nowhere/scan.nii.gz", node.state.message.message)
        for answer in (call("reset", Trigger), call("pause", SetBool, True),
                       call("recompute_homogenization", RecomputeHomogenization, "fine", [0, 0, 0], 0, False),
                       call("load_scan", LoadScan, "/etc/passwd", "", [])):
            self.assertFalse(answer.success)
            self.assertTrue(answer.message)
        answer = call("load_scan", LoadScan, "phantom:48x32x40", "", ["mesh/coarse_cells=5 5 5"])
        self.assertTrue(answer.success, answer.message)
        node.wait_until_running()
        self.assertLess(node.displacement(), 1e-6)

    def start(self, name, value):
        rospy.set_param("/wrong/sim", {})
        rospy.set_param("/wrong/sim/" + name, value)
        program = roslib.packages.find_node("pliant", "pliant_node")[0]
        return subprocess.run([program, "__ns:=/wrong", "__name:=sim"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              timeout=60, universal_newlines=True)

    def test_wrong_parameters_end_the_node(self):
        for name, value, named in (("solver/itterations", 3, "solver/iterations"), ("mesh/ratio", 99, "mesh/ratio"),
                                   ("tools", "a a", "twice"), ("scene", "/nowhere/scene.yaml", "/nowhere/scene.yaml")):
            ended = self.start(name, value)
            self.assertEqual(ended.returncode, 1, name)
            self.assertIn(named, ended.stdout)


if __name__ == "__main__":
    rostest.rosrun("pliant", "fault", FaultTest)
