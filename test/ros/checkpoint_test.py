#!/usr/bin/env python3
"""After SIGKILL, a new node restores the scan, materials, cuts, grasps and pose, and reports it. It refuses an
unsuitable checkpoint and keeps the file."""
import os
import signal
import sys
import time
import unittest
import xmlrpc.client

import numpy
import rosgraph
import rospy
import rostest
import tf2_ros
from dynamic_reconfigure.msg import Config, DoubleParameter
from dynamic_reconfigure.srv import Reconfigure
from geometry_msgs.msg import Point, Vector3, WrenchStamped
from pliant.msg import Session, SimState, Step
from pliant.srv import CutLine, Register
from std_msgs.msg import Header, String

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from node_client import NAMESPACE, Latest, Node, Tool, call, wait_for  # noqa: E402


class CheckpointTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("checkpoint_test")
        cls.folder = rospy.get_param("~folder")
        os.makedirs(cls.folder, exist_ok=True)
        cls.file = cls.folder + "/session.checkpoint"
        cls.node, cls.session = Node(), Latest("session", Session)
        cls.node.wait_until_running()

    def kill(self):
        """Kill the node and wait for the next one. Return the time of the kill."""
        address = rosgraph.Master("/checkpoint_test").lookupNode(NAMESPACE + "sim")
        os.kill(xmlrpc.client.ServerProxy(address).getPid("/checkpoint_test")[2], signal.SIGKILL)
        return rospy.Time.now()

    def wait_for_file(self):
        now = time.time()
        wait_for(lambda: os.path.exists(self.file) and os.path.getmtime(self.file) > now, "a checkpoint")

    def nodes(self):
        def matching():
            state = self.node.mesh.fresh()
            return state if state.revision == self.node.topology.message.revision else None
        return numpy.array(wait_for(matching, "a mesh state of this revision").nodes).reshape(-1, 3)

    def moved_within(self, seconds):
        """Return the maximum motion of a node between two states that are at least this time apart [m]."""
        before = self.nodes()
        time.sleep(seconds)
        return numpy.abs(self.nodes() - before).max()

    def runs_again(self, killed):
        def runs():
            state = self.node.state.message
            return state.header.stamp > killed and state.state == SimState.RUNNING and not state.is_busy
        wait_for(runs, "the node to be back")
        return (self.node.state.message.header.stamp - killed).to_sec()

    def test_1_it_comes_back_as_it_was(self):
        node = self.node
        with open(rospy.get_param(NAMESPACE + "sim/material/file")) as file:
            answer = node.set_materials(file.read().replace("name: liver", "name: jelly"))
        self.assertTrue(answer.success, answer.message)
        change = rospy.ServiceProxy(NAMESPACE + "sim/set_parameters", Reconfigure)
        change(Config(doubles=[DoubleParameter("gravity_z", -1.5)]))
        corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        placed = call("register", Register, Header(frame_id="world"), [Point(*p) for p in corners],
                      [Point(x, y, z + 0.25) for x, y, z in corners], 0)
        self.assertTrue(placed.success, placed.message)
        front, materials = node.front(), node.info.message.material_names
        line = [Point(front[0] + 0.03, front[1] - 0.1, front[2] + dz) for dz in (-0.03, 0.03)]
        cut = call("cut", CutLine, Header(frame_id="tissue"), line, Vector3(0, 0.12, 0))
        self.assertTrue(cut.success and cut.severed_area > 1e-3, cut.message)
        tool, force = Tool("grasper", "tissue"), Latest("grasper/measured_cf", WrenchStamped)
        self.addCleanup(tool.reset)
        tool.appear(front)
        wait_for(lambda: node.contact.fresh().touching, "the tool to touch")
        tool.take_hold(node.contact)
        tool.position = list(front - [0, 0.02, 0])
        wait_for(lambda: force.fresh().wrench.force.y < -0.05, "a force")
        wait_for(lambda: self.moved_within(0.2) < 1e-6, "the tissue to come to rest")
        self.wait_for_file()
        before, topology, pulled = self.nodes(), node.topology.message, force.fresh().wrench.force.y
        self.assertGreater(numpy.abs(before - numpy.array(topology.rest_nodes).reshape(-1, 3)).max(), 2e-3)

        killed = self.kill()
        seconds = self.runs_again(killed)
        print("back after %.2f s (asked: 5): %s" % (seconds, node.state.message.message))
        self.assertRegex(node.state.message.message, "went on from .*session.checkpoint.* 1 cuts, grasper was holding")
        wait_for(lambda: node.topology.message.header.stamp > killed and len(node.topology.message.cut_end) == 1,
                 "the topology with its cut")
        self.assertGreater(node.topology.message.revision, topology.revision)
        self.assertEqual(node.topology.message.severed, topology.severed)
        self.assertEqual(node.info.since(killed).material_names, materials)
        self.assertIn("jelly", materials)
        self.assertTrue(node.contact.fresh().grasped)
        after = self.nodes()
        print("nodes differ by %.2e m at most" % numpy.abs(after - before).max())
        self.assertLess(numpy.abs(after - before).max(), 2e-5)
        wait_for(lambda: abs(force.fresh().wrench.force.y - pulled) < 0.01 * abs(pulled),
                 "the force, which rises over 0.2 s")
        self.assertEqual(self.session.since(killed).gravity[2], -1.5)
        frames = tf2_ros.Buffer()
        tf2_ros.TransformListener(frames)
        wait_for(lambda: frames.can_transform("world", "tissue", rospy.Time(0)), "the tissue's frame")
        self.assertAlmostEqual(frames.lookup_transform("world", "tissue", rospy.Time(0)).transform.translation.z, 0.25)
        self.assertEqual(rospy.get_param(NAMESPACE + "sim/model/gravity")[2], -1.5)
        # the restored tissue continues in the same way
        tool.closed = False
        wait_for(lambda: not node.contact.fresh().grasped, "the tool to let go")

    def test_3_an_instrument_that_is_exchanged_has_another_shape(self):
        step, tool_type = (Latest("step", Step), rospy.Publisher(NAMESPACE + "grasper/tool_type", String, queue_size=1,
                                                                 latch=True))
        self.assertEqual(len(step.fresh().tools[0].shape), 0)
        before = []
        for name in ("LARGE_NEEDLE_DRIVER:400006", "PERMANENT_CAUTERY_HOOK:400183"):
            tool_type.publish(name)
            wait_for(lambda: step.fresh().tools[0].shape not in ([], before), "the shape of " + name)
            before = step.message.tools[0].shape
        tool_type.publish("A_SPOON:1")
        wait_for(lambda: len(step.fresh().tools[0].shape) == 0, "no shape of what nobody knows")
        self.node.goes_on()

    def test_1b_another_pose_that_it_is_started_with_holds(self):
        self.wait_for_file()
        rospy.set_param(NAMESPACE + "sim/tissue_pose", "0.1 0 0.5 0 0 0 1")
        rospy.set_param(NAMESPACE + "sim/output/mesh_rate", 20.0)
        killed = self.kill()
        self.runs_again(killed)
        told = self.session.since(killed)
        self.assertEqual([told.mesh_rate, told.gravity[2]], [20, -1.5],
                         "what it is started with holds, and what was set live")
        self.assertIn("went on from", self.node.state.message.message)
        frames = tf2_ros.Buffer()
        tf2_ros.TransformListener(frames)

        def height():
            return (frames.can_transform("world", "tissue", rospy.Time(0))
                    and frames.lookup_transform("world", "tissue", rospy.Time(0)).transform.translation.z)
        wait_for(lambda: height() == 0.5, "the new pose")

    def test_2_what_does_not_fit_is_refused_and_kept(self):
        for content, words in ((b"no bag at all", "session.checkpoint"), (None, "another scan")):
            self.wait_for_file()
            if content is None:
                rospy.set_param(NAMESPACE + "sim/scan/path", "phantom:48x32x40")
            start = time.time()
            killed = self.kill()
            if content:
                with open(self.file, "wb") as file:
                    file.write(content)
            self.runs_again(killed)
            self.assertRegex(self.node.state.message.message, "refused.*" + words)
            self.assertGreaterEqual(os.path.getmtime(self.file + ".refused"), start - 1)
            self.assertEqual(len(self.node.topology.since(killed).cut_end), 0)
        self.assertEqual(list(self.node.info.message.size), [48, 32, 40])


if __name__ == "__main__":
    rostest.rosrun("pliant", "checkpoint", CheckpointTest)
