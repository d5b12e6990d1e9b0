#!/usr/bin/env python3
"""Test faults: a restarted master, a missing scan that load_scan replaces, a wrong parameter that ends the node, odd
time stamps, scans without a usable image, and the last error for late subscribers."""
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest

import numpy
import rosgraph
import roslib.packages
import rospy
import rostest
import tf2_ros
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, TransformStamped
from pliant.msg import SimState
from pliant.srv import LoadScan, RecomputeHomogenization, Register
from rosgraph_msgs.msg import Log
from std_msgs.msg import Empty, Header
from std_srvs.srv import SetBool, Trigger

FOLDER = os.path.dirname(os.path.realpath(__file__))
sys.path[:0] = [FOLDER, os.path.dirname(FOLDER)]
import stopped  # noqa: E402
from node_client import Latest, Node, Tool, WholeVolume, call, wait_for  # noqa: E402


SMALL = "phantom:48x32x40"


class FaultTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("fault_test")
        cls.node = Node()
        cls.diagnostics = Latest("/diagnostics", DiagnosticArray)

    def load_small(self):
        answer = self.node.load(SMALL, options=["mesh/coarse_cells=5 5 5"])
        self.assertTrue(answer.success, answer.message)

    def diagnosed(self):
        """Return the node's last diagnostics: {name: (status, values)}."""
        statuses = self.diagnostics.message.status if self.diagnostics.message else []
        return {status.name.split(": ")[-1]: (status, {value.key: value.value for value in status.values})
                for status in statuses}

    def diagnosis(self, name):
        """Return the last diagnostics message with this name. A node that starts reports that."""
        found = self.diagnosed()
        return found[name][0].message if name in found else ""

    # first in alphabetical order, so that nothing is loaded yet
    def test_a_missing_scan_is_a_fault_that_load_scan_mends(self):
        node = self.node
        wait_for(lambda: node.state.message and node.state.message.state == SimState.FAULT, "FAULT")
        wait_for(lambda: not node.state.message.is_busy, "the state to be idle")
        self.assertIn("/nowhere/scan.nii.gz", node.state.message.message)
        for answer in (call("reset", Trigger), call("pause", SetBool, True),
                       call("recompute_homogenization", RecomputeHomogenization, "fine", [0, 0, 0], 0, False),
                       call("load_scan", LoadScan, "/etc/passwd", "", [])):
            self.assertFalse(answer.success)
            self.assertTrue(answer.message)
        self.load_small()
        self.assertLess(node.displacement(), 1e-6)

    def test_stamps_out_of_all_bounds_mean_no_tool(self):
        self.load_small()
        tool = Tool("grasper", "tissue")
        self.addCleanup(tool.reset)
        tool.position, tool.is_on = list(self.node.front()), True
        half = 1 << 31  # seconds; beyond the range of ros::Duration
        for stamp in (lambda: rospy.Time((rospy.Time.now().secs + half) % (2 * half), 999999999),
                      lambda: rospy.Time((rospy.Time.now().secs + half + 9) % (2 * half), 999999999),
                      lambda: rospy.Time(2 * half - 1, 999999999), lambda: rospy.Time(0, 1)):
            tool.stamp = stamp

            def is_told():
                values = self.diagnosed().get("tool grasper", (None, {}))[1]
                age = rospy.Time.now().secs - stamp().secs
                told = values.get("age [ms]", "no pose")
                return told != "no pose" and abs(float(told) / 1e3 - age) < 4
            wait_for(is_told, "diagnostics of a tool with that stamp")
            self.assertFalse(self.node.contact.fresh().present)
            self.node.goes_on()
        wait_for(lambda: tool.pose.get_num_connections(), "the node to listen still")

    def say_where(self, frame, late):
        """Publish the transform of a frame at the tissue's position 50 times per second, with time stamps that are
        `late` seconds old."""
        sender, message = tf2_ros.TransformBroadcaster(), TransformStamped()
        message.header.frame_id, message.child_frame_id = "tissue", frame
        message.transform.rotation.w = 1

        def send(_):
            message.header.stamp = rospy.Time.now() - rospy.Duration(late)
            sender.sendTransform(message)
        timer = rospy.Timer(rospy.Duration(0.02), send)
        self.addCleanup(timer.shutdown)
        return timer

    def test_poses_wait_for_a_frame_that_comes_late_and_not_for_one_that_is_stale(self):
        self.load_small()
        camera = self.say_where("camera", 0.1)  # always older than the last pose
        tool = Tool("grasper", "camera")
        self.addCleanup(tool.reset)
        tool.appear(self.node.front())
        wait_for(lambda: self.node.contact.fresh().present, "the tool")
        seen = []
        watch = rospy.Subscriber("/tissue/grasper/contact", type(self.node.contact.message),
                                 lambda message: seen.append(message.present))
        # on a busy machine, a transform may be late once
        wait_for(lambda: len(seen) > 30 and all(seen[-30:]), "30 successive contact messages with the tool")
        watch.unregister()
        tool.take_hold(self.node.contact)
        camera.shutdown()  # while the poses continue
        wait_for(lambda: not self.node.contact.fresh().present, "the tool to be gone")
        self.assertFalse(self.node.contact.fresh().grasped)
        wait_for(lambda: "has no transform" in self.diagnosis("tool grasper"),
                 "the frame of which nothing more is heard")

    def test_a_short_gap_keeps_the_hold_and_a_long_one_says_why_it_is_lost(self):
        self.load_small()
        tool = Tool("grasper", "tissue")
        self.addCleanup(tool.reset)
        tool.appear(self.node.front())
        tool.take_hold(self.node.contact)
        logged = []
        watch = rospy.Subscriber("/rosout", Log, lambda message: logged.append(message.msg))
        wait_for(watch.get_num_connections, "the log")
        tool.is_on = False
        time.sleep(1)  # twice the maximum age of a pose
        self.assertTrue(self.node.contact.fresh().grasped)
        self.assertFalse([line for line in logged if "releases its grasp" in line])
        wait_for(lambda: not self.node.contact.fresh().grasped, "the tool to let go")
        lost = wait_for(lambda: [line for line in logged if "releases its grasp" in line], "a word on why")
        watch.unregister()
        self.assertRegex(lost[0], "tool grasper releases its grasp.* old")

    def test_jaws_that_close_while_poses_are_old_are_told_of(self):
        self.load_small()
        tool = Tool("grasper", "tissue")
        self.addCleanup(tool.reset)
        tool.appear(self.node.front())
        wait_for(lambda: self.node.contact.fresh().touching, "the tool to touch")
        logged = []
        watch = rospy.Subscriber("/rosout", Log, lambda message: logged.append(message.msg))
        self.addCleanup(watch.unregister)
        wait_for(watch.get_num_connections, "the log")

        def told():
            return [line for line in logged if "grasper has closed its jaws and takes nothing" in line]
        tool.pose_age = 3
        wait_for(lambda: not self.node.contact.fresh().present, "the tool to be gone")
        began = time.time()
        tool.closed = True
        wait_for(lambda: len(told()) > 1, "a word on it, once a second")
        self.assertRegex(told()[0], "old, more than 500 ms .~tool_max_age")
        self.assertLessEqual(len(told()), 2 + (time.time() - began))
        tool.closed, tool.pose_age = False, 0
        tool.take_hold(self.node.contact)

    def test_a_step_that_takes_long_is_an_error_while_it_runs(self):
        # ten thousand sub-steps
        options = ["mesh/coarse_cells=5 5 5", "solver/kind=tled", "tled/safety=0.01", "solver/step=0.04"]
        self.addCleanup(self.load_small)
        self.assertTrue(call("load_scan", LoadScan, SMALL, "", options).success)
        errors = []

        def is_error():
            status, values = self.diagnosed().get("solver", (None, {}))
            if status and status.level == DiagnosticStatus.ERROR:
                errors.append((status.message, float(values["current step [ms]"]), values["steps above 500 ms"]))
            return any(busy > 500 for _, busy, _ in errors)
        wait_for(is_error, "an error in diagnostics while a step runs")
        self.assertIn("a step takes", errors[-1][0])

    def test_small_changes_come_at_rest_and_what_is_outside_the_region_never(self):
        """volume_threshold 100, volume_region up to x = 0.01 m"""
        self.load_small()
        volume = WholeVolume()
        self.addCleanup(volume.close)
        rest = wait_for(volume.copy, "the whole volume")
        ask = rospy.Publisher("/tissue/volume/resend", Empty, queue_size=1)
        wait_for(ask.get_num_connections, "the node to listen")
        whole = volume.message
        last = whole.origin.position.x + (whole.full_size[0] - 1) * whole.spacing.x
        self.assertLessEqual(last, 0.01 + 1e-6)
        self.assertGreater(last + whole.spacing.x, 0.01)
        tool = Tool("grasper", "tissue")
        self.addCleanup(tool.reset)
        point = self.node.front()
        tool.appear(point)
        tool.take_hold(self.node.contact)
        tool.position = list(point - [0, 0.02, 0])
        volume.when(lambda pulled: numpy.count_nonzero(pulled != rest) > 20, "the volume to change")
        self.assertTrue(call("pause", SetBool, True).success)
        self.addCleanup(call, "pause", SetBool, False)
        boxes = []

        def whole_again():
            boxes[:] = [wait_for(volume.copy, "the whole volume")]
            first = volume.sequence
            ask.publish()
            return wait_for(lambda: volume.since_whole == 0 and volume.sequence > first and volume.copy(),
                            "the whole volume again")
        wait_for(lambda: numpy.array_equal(whole_again(), boxes[0]),
                 "what is put together to be the whole, small changes, too")

    def test_diagnostics_tell_why_there_is_no_tool(self):
        self.load_small()
        tool = Tool("grasper", "nowhere")
        self.addCleanup(tool.reset)
        tool.appear(self.node.front())

        def told(words):
            return words in self.diagnosis("tool grasper")
        wait_for(lambda: told('"nowhere"') or told("nowhere"), "the frame that is unknown")
        tool.frame, tool.stamp = "tissue", lambda: rospy.Time.now() + rospy.Duration(5)
        wait_for(lambda: told("ahead"), "the clock that is ahead")
        tool.stamp = rospy.Time.now
        wait_for(lambda: told("tracked") or told("slow"), "the tool")

    def test_the_state_tells_why_a_load_failed_until_one_succeeds(self):
        self.load_small()
        self.assertFalse(self.node.load("none.nii.gz").success)
        self.node.goes_on()
        late = Latest("state", SimState)
        wait_for(lambda: late.message, "the latched state")
        late.close()
        self.assertEqual(late.message.state, SimState.RUNNING)
        self.assertIn("load_scan", late.message.message)
        self.load_small()
        wait_for(lambda: self.node.state.message.message == "", "the message to go")

    def test_a_volume_too_large_to_be_made_is_refused(self):
        self.load_small()
        answer = self.node.load(SMALL, options=["mesh/coarse_cells=5 5 5", "warp/margin=10"])
        self.assertFalse(answer.success)
        self.assertRegex(answer.message, "[0-9]{4} x [0-9]{4} x [0-9]{4}")
        self.node.goes_on()

    def test_what_was_recomputed_and_the_materials_are_kept(self):
        def loaded(*options):
            answer = self.node.load(SMALL, options=options)
            self.assertTrue(answer.success, answer.message)
            info = self.node.info.message
            return info.method, info.coarse_tetrahedra, list(info.material_names)
        self.load_small()
        answer = self.node.recompute("averaged", (5, 4, 5))
        self.assertTrue(answer.success, answer.message)
        answer = self.node.set_materials("materials:\n  - {name: air, young_modulus: 10, poisson_ratio: 0, "
                      "density: 1.2, empty: true, range: [-1.0e+9, -900]}\n  - {name: jelly, young_modulus: 3000, "
                      "poisson_ratio: 0.4, density: 1000, range: [-900, 200]}\n"
                      "  - {name: stone, young_modulus: 1.0e+6, "
                      "poisson_ratio: 0.3, density: 1000, fixed: true, range: [200, 1.0e+9]}\n")
        self.assertTrue(answer.success, answer.message)
        names = ["air", "jelly", "stone"]
        kept = loaded()
        self.assertEqual((kept[0], kept[2]), ("averaged", names))
        other = loaded("model/method=coarse", "mesh/coarse_cells=5 5 5", "material/file=")
        self.assertEqual(other[0], "coarse")
        self.assertGreater(other[1], kept[1])
        self.assertNotIn("jelly", other[2])
        self.assertEqual(loaded(), kept)

    def test_diagnostics_name_the_backend(self):
        self.load_small()

        def told():
            found = self.diagnosed()
            scan = found.get("backend", (None, {}))[1].get("scan")
            return found if scan == self.node.info.message.scan_id else None
        found = wait_for(told, "diagnostics of the scan that is loaded")
        backend, values = found["backend"]
        self.assertIn(backend.message, ("cpu", "cuda"))
        self.assertEqual(values["threads"], "1")
        self.assertEqual(values["elements"], "hexahedra", "what element/kind: auto became")
        self.assertEqual(found["output"][0].level, 0)

    def wrong_node(self, name, value):
        """Return the command of a node with only this parameter."""
        rospy.set_param("/wrong/sim", {})
        rospy.set_param("/wrong/sim/" + name, value)
        return [roslib.packages.find_node("pliant", "pliant_node")[0], "__ns:=/wrong", "__name:=sim"]

    def test_a_master_that_is_started_anew_knows_the_node_again(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        uri = "http://127.0.0.1:%d" % port
        master, environment = (rosgraph.Master("/fault_test", uri),
                               dict(os.environ, ROS_MASTER_URI=uri, ROSCONSOLE_STDOUT_LINE_BUFFERED="1"))
        said = tempfile.TemporaryFile("w+")
        self.addCleanup(said.close)

        def start(*command):
            process = subprocess.Popen(command, env=environment, stdout=said, stderr=subprocess.STDOUT)
            self.addCleanup(process.wait)
            self.addCleanup(process.kill)
            return process

        def start_master():
            # in a container, a restarted master often has the same process ID
            program = "import os; os.getpid = lambda: 7; from rosmaster.main import rosmaster_main; rosmaster_main()"
            process = start(sys.executable, "-c", program, "--core", "-p", str(port))
            wait_for(lambda: answers(master.is_online), "a master")
            return process

        def answers(question):
            try:
                return question()
            except (OSError, rosgraph.MasterException):
                return None

        def known():
            """Return the master's entries of the node."""
            state = answers(master.getSystemState)
            return state and [set(name for name, nodes in kind if "/tissue/sim" in nodes) for kind in state]
        first = start_master()
        node = start(roslib.packages.find_node("pliant", "pliant_node")[0], "__ns:=/tissue", "__name:=sim",
                     "_scan/path:=" + SMALL, "_tools:=grasper")
        wait_for(lambda: known() and "/diagnostics" in known()[0], "the node")
        wait_for(lambda: "/tissue/load_scan" in known()[2], "its services")
        setting = "config: {doubles: [{name: slice_axial, value: 0.25}]}"
        subprocess.check_call(["rosservice", "call", "/tissue/sim/set_parameters", setting], env=environment,
                              stdout=subprocess.DEVNULL, timeout=60)
        wait_for(lambda: answers(lambda: master.getParam("/tissue/sim/slice/axial")) == 0.25, "what was set live")
        time.sleep(1.2)  # the watch checks once per second
        before = known()
        first.send_signal(signal.SIGINT)
        first.wait()
        start_master()
        wait_for(lambda: known() == before, "the same topics and services")
        wait_for(lambda: answers(lambda: master.getParam("/tissue/sim/slice/axial")) == 0.25, "what was set live")
        self.assertEqual(master.getParam("/tissue/sim/scan/path"), SMALL)
        told = subprocess.run(["rostopic", "echo", "-n", "1", "/diagnostics"], env=environment, stdout=subprocess.PIPE,
                              universal_newlines=True, timeout=60)
        self.assertRegex(told.stdout, 'key: "registered again"\n *value: "1"')
        self.assertNotRegex(told.stdout, 'key: "steps in the last second"\n *value: "0"')
        self.assertIsNone(node.poll())
        said.seek(0)
        self.assertIn("the master was restarted", said.read())

    def test_wrong_parameters_end_the_node(self):
        for name, value, named in (("solver/itterations", 3, "solver/iterations"), ("mesh/ratio", 99, "mesh/ratio"),
                                   ("tools", "a a", "twice"), ("scene", "/nowhere/scene.yaml", "/nowhere/scene.yaml")):
            ended = subprocess.run(self.wrong_node(name, value), stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                   timeout=60, universal_newlines=True)
            self.assertEqual(ended.returncode, 1, name)
            self.assertIn(named, ended.stdout)

    def test_a_node_that_loads_or_steps_ends_within_a_second(self):
        rospy.set_param("/ending/sim/mesh", {"coarse_cells": [24, 20, 20], "ratio": 2})
        command = [roslib.packages.find_node("pliant", "pliant_node")[0], "__ns:=/ending", "__name:=sim",
                   "_solver/preconditioner:=direct"]
        state = Latest("/ending/state", SimState)
        for number, scan, wanted in ((signal.SIGINT, "phantom:120x90x80", SimState.LOADING),
                                     (signal.SIGTERM, "phantom:120x90x80", SimState.LOADING),
                                     (signal.SIGTERM, SMALL, SimState.RUNNING)):
            if wanted == SimState.RUNNING:
                rospy.delete_param("/ending/sim/mesh")
            state.message = None
            node = subprocess.Popen(command + ["_scan/path:=" + scan])
            self.addCleanup(node.wait)
            self.addCleanup(node.kill)
            wait_for(lambda: state.message and state.message.state == wanted, "the node")
            time.sleep(1)
            self.assertIsNone(node.poll())
            self.assertLess(stopped.stop(node, number)[1], 1)
        state.close()

    def test_the_tissue_and_the_arms_lie_where_files_say(self):
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder)
        with open(folder + "/hand_eye.json", "w") as file:
            file.write('{"base-frame": {"reference-frame": "camera", "transform": [[0, -1, 0, 0.1], [1, 0, 0, -0.02], '
                       '[0, 0, 1, 0.2], [0, 0, 0, 1]]}}')
        command = [roslib.packages.find_node("pliant", "pliant_node")[0], "__ns:=/placed", "__name:=sim",
                   "_scan/path:=" + SMALL, "_parent_frame:=camera",
                   "_tissue_frame:=placed_tissue", "_registration:=" + folder + "/pose.yaml",
                   "_hand_eye:=PSM1_base=" + folder + "/hand_eye.json"]
        frames = tf2_ros.Buffer()
        tf2_ros.TransformListener(frames)

        def height():
            found = frames.can_transform("PSM1_base", "placed_tissue", rospy.Time(0))
            return (found and round(frames.lookup_transform("PSM1_base", "placed_tissue",
                                                            rospy.Time(0)).transform.translation.z, 9))

        def start():
            node = subprocess.Popen(command)
            self.addCleanup(node.wait)
            self.addCleanup(node.kill)
            return node
        node = start()
        wait_for(lambda: height() == -0.2, "the frames")
        corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        def register(room, tissue=corners):
            return rospy.ServiceProxy("/placed/register", Register)(Header(frame_id="PSM1_base"),
                                                                    [Point(*p) for p in tissue], room, 0)
        rospy.wait_for_service("/placed/register", 30)
        collinear = register([Point(x + y, 0, 0) for x, y, _ in corners])
        self.assertFalse(collinear.success)
        self.assertIn("line", collinear.message)
        answer = register([Point(x, y, 0.3 + 0.003 * x) for x, y, _ in corners])
        self.assertTrue(answer.success, answer.message)
        self.assertTrue(0 < answer.error < 3e-3, answer.message)
        kept = wait_for(lambda: height() not in (False, -0.2) and height(), "the pose that was registered")
        with open(folder + "/pose.yaml") as file:
            text = file.read()
        millimetres = register([Point(1e3 * x, 1e3 * y, 300) for x, y, _ in corners])
        self.assertFalse(millimetres.success)
        self.assertIn("millimetres?", millimetres.message)
        solid = corners + [(0, 0, 1)]
        mirrored = register([Point(-x, y, z) for x, y, z in solid], solid)
        self.assertFalse(mirrored.success)
        self.assertIn("mirrored?", mirrored.message)
        self.assertGreater(mirrored.error, 0.01)
        self.assertEqual(mirrored.pose, answer.pose)
        with open(folder + "/pose.yaml") as file:
            self.assertEqual(file.read(), text, "what is refused leaves the file")
        self.assertEqual(height(), kept)
        node.send_signal(signal.SIGINT)
        node.wait()
        frames.clear()
        start()
        wait_for(lambda: height() == kept, "the pose that was stored")

    def test_a_node_that_is_started_again_and_again_tells_of_a_wrong_parameter(self):
        state = Latest("/wrong/state", SimState)
        command = self.wrong_node("mesh/ratio", 99)
        rospy.set_param("/wrong/sim/respawn", True)
        node = subprocess.Popen(command)
        self.addCleanup(node.wait)
        self.addCleanup(node.kill)
        wait_for(lambda: state.message and state.message.state == SimState.FAULT, "FAULT")
        self.assertIn("mesh/ratio", state.message.message)
        wait_for(lambda: "mesh/ratio" in self.diagnosis("parameters"), "diagnostics")
        self.assertIsNone(node.poll())
        state.close()

    def test_a_nodelet_that_cannot_begin_tells_why_and_leaves_its_manager(self):
        """The manager may contain other nodelets. An error that ends a node, such as a missing file, is only a FAULT
        of the nodelet."""
        state = Latest("/held/state", SimState)
        self.addCleanup(state.close)
        manager = subprocess.Popen([roslib.packages.find_node("nodelet", "nodelet")[0], "standalone", "pliant/tissue",
                                    "__ns:=/held", "__name:=sim",
                                    "_hand_eye:=PSM1_base=/nowhere/PSM1.json"])
        self.addCleanup(manager.wait)
        self.addCleanup(manager.kill)
        wait_for(lambda: state.message and state.message.state == SimState.FAULT, "FAULT")
        self.assertIn("/nowhere/PSM1.json", state.message.message)
        wait_for(lambda: "/nowhere/PSM1.json" in self.diagnosis("parameters"), "diagnostics")
        self.assertIsNone(manager.poll())

    def test_a_node_whose_file_cannot_be_read_yet_ends_to_be_started_again(self):
        command = self.wrong_node("hand_eye", "PSM1_base=/nowhere/PSM1.json")
        rospy.set_param("/wrong/sim/respawn", True)
        node = subprocess.Popen(command)
        self.addCleanup(node.wait)
        self.addCleanup(node.kill)
        self.assertEqual(node.wait(30), 1)


if __name__ == "__main__":
    rostest.rosrun("pliant", "fault", FaultTest)
