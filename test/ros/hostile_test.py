#!/usr/bin/env python3
"""Test peers that never read, that connect and disconnect, that send invalid poses, and that send endless requests.
The simulation continues, and its memory stays bounded."""
import os
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import xmlrpc.client

import numpy
import rosbag
import rosgraph
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from pliant.msg import MeshState, Step
from pliant.srv import Pick
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from node_client import NAMESPACE, Latest, Node, Tool, call, wait_for  # noqa: E402

MOST = 40e6  # maximum memory of queues and connections in a test [bytes]


class HostileTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("hostile_test")
        cls.node, cls.step = Node(), Latest("step", Step)
        cls.node.wait_until_running()
        address = rosgraph.Master("/hostile_test").lookupNode(NAMESPACE + "sim")
        cls.api = xmlrpc.client.ServerProxy(address)
        cls.pid = cls.api.getPid("/hostile_test")[2]

    def setUp(self):
        self.before = self.resident()

    def resident(self):
        with open("/proc/%d/statm" % self.pid) as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    def goes_on(self):
        """Check that steps continue at their rate and none fails."""
        self.node.goes_on()

        def made():
            first = self.step.fresh()
            time.sleep(0.5)
            return self.step.fresh().sequence - first.sequence
        wait_for(lambda: made() > 5, "steps at their rate")
        self.assertLess(self.resident() - self.before, MOST)

    def never_reads(self, topic, kind):
        """Open a subscriber's connection and never read its socket."""
        code, text, (_, host, port) = self.api.requestTopic("/never_reads", NAMESPACE + topic, [["TCPROS"]])
        self.assertEqual(code, 1, text)
        link = socket.socket()
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        link.connect((host, port))
        fields = ["callerid=/never_reads", "topic=" + NAMESPACE + topic, "type=" + kind._type, "md5sum=" + kind._md5sum]
        body = b"".join(struct.pack("<I", len(field)) + field.encode() for field in fields)
        link.sendall(struct.pack("<I", len(body)) + body)
        self.addCleanup(link.close)

    def test_subscribers_that_never_read(self):
        for _ in range(4):
            self.never_reads("mesh/state", MeshState)
            self.never_reads("step", Step)
        time.sleep(1.5)
        self.goes_on()

    def test_fifty_that_come_and_go(self):
        for _ in range(50):
            subscriber = rospy.Subscriber(NAMESPACE + "mesh/state", MeshState, lambda message: None)
            pose = rospy.Publisher(NAMESPACE + "grasper/measured_cp", PoseStamped, queue_size=1)
            wait_for(lambda: subscriber.get_num_connections() and pose.get_num_connections(), "both links", pause=0.001)
            subscriber.unregister()
            pose.unregister()
        self.goes_on()

    def test_messages_that_are_none(self):
        joints = rospy.Publisher(NAMESPACE + "grasper/jaw/measured_js", JointState, queue_size=4)
        pedal = rospy.Publisher(NAMESPACE + "knife/energy", Joy, queue_size=4)
        wrong = rospy.Publisher(NAMESPACE + "grasper/measured_cp", String, queue_size=4)
        wait_for(lambda: joints.get_num_connections() and pedal.get_num_connections(), "the node to listen")
        huge = JointState(position=[0.1] * 400000, name=["j"])
        huge.header.stamp = rospy.Time.now()
        for _ in range(5):
            joints.publish(huge)
            joints.publish(JointState())
            joints.publish(JointState(position=[float("nan")]))
            pedal.publish(Joy())
            pedal.publish(Joy(buttons=[7] * 300000))
            wrong.publish("no pose")
            time.sleep(0.1)
        for publisher in (joints, pedal, wrong):
            publisher.unregister()
        self.goes_on()

    def test_poses_that_are_no_numbers(self):
        """For a tool that grasps and for a blade that is on: both are absent, the grasp is released, and nothing is
        cut."""
        grasper, knife = Tool("grasper", "tissue"), Tool("knife", "tissue")
        blade = rospy.Publisher(NAMESPACE + "knife/blade", Bool, queue_size=1, latch=True)
        whole = self.node.topology.message.revision
        self.addCleanup(blade.unregister)
        self.addCleanup(knife.reset)
        self.addCleanup(grasper.reset)

        def there():
            return {tool.name: tool for tool in self.step.fresh().tools if tool.present}
        front = self.node.front()
        grasper.appear(front)
        grasper.take_hold(self.node.contact)
        grasper.position[1] -= 0.01
        wait_for(lambda: self.node.displacement() > 0.003, "the tissue to be pulled")
        knife.appear(front + [0, -0.1, 0])  # in air
        blade.publish(True)
        wait_for(lambda: "knife" in there() and there()["knife"].cuts, "the blade to be on")
        grasper.is_on = knife.is_on = False
        message, nan, inf = PoseStamped(), float("nan"), float("inf")
        message.header.frame_id = "tissue"
        for position, turn in (((nan, 0, 0), (0, 0, 0, 1)), ((0, 0, -inf), (0, 0, 0, 1)), (front, (nan, 0, 0, 1)),
                               (front, (0, 0, 0, nan)),
                               (front, (nan, nan, nan, nan)), (front, (0, inf, 0, 1)), (front, (0, 0, 0, 0)),
                               (front, (1e200, 0, 0, 1e200)), ((nan, nan, nan), (nan, nan, nan, nan))):
            message.pose.position.x, message.pose.position.y, message.pose.position.z = position
            (message.pose.orientation.x, message.pose.orientation.y, message.pose.orientation.z,
             message.pose.orientation.w) = turn
            for _ in range(3):
                message.header.stamp = rospy.Time.now()
                grasper.pose.publish(message)
                knife.pose.publish(message)
                time.sleep(0.02)
            if position[0] != position[0] and turn == (0, 0, 0, 1):
                wait_for(lambda: not there(), "the first of them to come")
            self.assertFalse(there(), "%s %s" % (position, turn))
            self.assertTrue(numpy.isfinite(self.node.mesh.fresh().nodes).all(), "%s %s" % (position, turn))
            self.assertFalse(self.node.contact.fresh().grasped)
        wait_for(lambda: self.node.displacement() < 1e-3, "the tissue to come back")
        self.assertEqual(self.step.message.revision, whole, "nothing is cut")
        grasper.appear(front)
        grasper.take_hold(self.node.contact)
        self.goes_on()

    def test_poses_without_a_pause(self):
        poses = rospy.Publisher(NAMESPACE + "grasper/measured_cp", PoseStamped, queue_size=10000)
        wait_for(poses.get_num_connections, "the node to listen")
        message, sent, end = PoseStamped(), 0, time.time() + 1.5
        message.header.frame_id = "tissue"
        message.pose.orientation.w = 1
        while time.time() < end:
            message.header.stamp = rospy.Time.now()
            poses.publish(message)
            sent += 1
        print("%d poses a second" % (sent / 1.5))
        poses.unregister()
        self.goes_on()

    def test_services_in_a_loop(self):
        pick = rospy.ServiceProxy(NAMESPACE + "pick", Pick)
        end = time.time() + 1
        while time.time() < end:
            pick(Pick._request_class())
            self.assertTrue(call("reset", Trigger).success)
            self.assertFalse(call("undo_cut", Trigger).success)
        self.goes_on()

    def test_a_checkpoint_that_cannot_be_written_is_told(self):
        diagnostics = Latest("/diagnostics", DiagnosticArray)
        wait_for(lambda: diagnostics.message and any("no checkpoint" in status.message
                                                     and "/nowhere/at/all" in status.message
                                                     for status in diagnostics.message.status), "diagnostics to tell")
        diagnostics.close()
        self.goes_on()

    def test_a_disk_that_is_full_while_a_bag_is_recorded(self):
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder)
        alone = ["unshare", "-m" if os.geteuid() == 0 else "-rm"]
        small = "mount -t tmpfs -o size=3m tmpfs %s/disk" % folder
        os.makedirs(folder + "/disk")
        if subprocess.run(alone + ["sh", "-c", small], stderr=subprocess.DEVNULL).returncode != 0:
            self.skipTest("this user may not mount a small disk here")
        said = {}
        diagnostics = rospy.Subscriber("/diagnostics", DiagnosticArray,
                                       lambda message: said.update({status.name.split(": ")[-1]: status.message
                                                                    for status in message.status}))
        recorder = subprocess.Popen(alone + ["sh", "-c", "trap : INT; " + small + " && roslaunch pliant record.launch "
                                             "bag:=%s/disk/full.bag min_space:=1; cp %s/disk/* %s" %
                                             (folder, folder, folder)],
                                    start_new_session=True)
        self.addCleanup(recorder.wait)
        self.addCleanup(lambda: recorder.poll() is None and os.killpg(recorder.pid, signal.SIGINT))
        wait_for(lambda: said.get("recording") == "recording" or "nearly" in said.get("recording", ""),
                 "diagnostics to tell that it is recorded")
        pedal = rospy.Publisher("/some/energy", Joy, queue_size=1)
        wait_for(pedal.get_num_connections, "the recorder")
        self.step.fresh()

        def is_full():
            pedal.publish(Joy(axes=numpy.random.rand(20000)))
            return "the disk is full" in said.get("recording", "")
        wait_for(is_full, "the disk to be full", pause=0.05)
        self.goes_on()
        pedal.unregister()
        os.killpg(recorder.pid, signal.SIGINT)
        recorder.wait()
        diagnostics.unregister()
        left, = [name for name in os.listdir(folder) if ".bag" in name]
        path = os.path.join(folder, left)
        if left.endswith(".active"):
            subprocess.check_call(["rosbag", "reindex", "-q", path])
        with rosbag.Bag(path) as bag:
            made = [message.sequence for _, message, _ in bag.read_messages(NAMESPACE + "step")]
        self.assertGreater(len(made), 10)
        self.assertEqual(made, list(range(made[0], made[0] + len(made))), "nothing is missing before the end")

    def test_a_tool_among_them_is_there(self):
        tool = Tool("grasper", "tissue")
        self.addCleanup(tool.reset)
        self.never_reads("mesh/state", MeshState)
        tool.appear(self.node.front())
        tool.take_hold(self.node.contact)


if __name__ == "__main__":
    rostest.rosrun("pliant", "hostile", HostileTest)
