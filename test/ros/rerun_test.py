#!/usr/bin/env python3
"""Recompute a session from its recorded tool inputs, bit for bit. On a busy machine no step of the session has
waited for background work."""
import csv
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import unittest

import numpy as np
import rosbag
import rospy
import rostest
from dynamic_reconfigure.msg import Config, DoubleParameter
from dynamic_reconfigure.srv import Reconfigure
from geometry_msgs.msg import Point, Vector3
from pliant.msg import Step
from pliant.srv import CutLine
from std_msgs.msg import Header
from std_srvs.srv import Trigger

FOLDER = os.path.dirname(os.path.realpath(__file__))
sys.path[:0] = [FOLDER, os.path.dirname(FOLDER)]
import stopped  # noqa: E402
from node_client import NAMESPACE, Latest, Launch, Node, Tool, call, is_sent, wait_for  # noqa: E402

SCAN = "phantom:72x48x60"
SECONDS = 60.0  # time limit on a busy machine
TURNS = 120


def write_scene(path):
    """Write the demo scene with a mesh that needs long factorizations, few states, and cuts."""
    launch = subprocess.check_output(["rospack", "find", "pliant"], universal_newlines=True).strip() + "/launch"
    with open(launch + "/scenes/demo.yaml") as file:
        text = file.read()
    for old, new in (("../materials", launch + "/materials"), ("ratio: 2", "ratio: 3"),
                     ("output:\n", "output:\n  mesh_rate: 5\n")):
        assert old in text, old
        text = text.replace(old, new)
    with open(path, "w") as file:
        file.write(text + "cut:\n  kind: sever\n")


class RerunTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("rerun_test")
        cls.folder = rospy.get_param("~folder")
        shutil.rmtree(cls.folder, ignore_errors=True)
        os.makedirs(cls.folder)
        cls.bag, cls.scene = cls.folder + "/session.bag", cls.folder + "/scene.yaml"
        write_scene(cls.scene)
        cls.record()
        with rosbag.Bag(cls.bag) as bag:
            cls.steps = [message for _, message, _ in bag.read_messages(NAMESPACE + "step")]

    @classmethod
    def record(cls):
        """Record while one busy process per core runs."""
        live = Launch("tissue.launch", scan=SCAN, scene=cls.scene, tool_max_age="1", parent_frame="")
        busy, recorder = [], None
        try:
            node, tool = Node(), Tool("grasper", "tissue")
            node.wait_until_running()
            recorder = Launch("record.launch", bag=cls.bag)
            for topic in ("mesh/topology", "mesh/state", "step"):
                wait_for(lambda: is_sent("sim", topic, "/record_tissue"), "the recorder", SECONDS)
            busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count())]
            assert call("reset", Trigger).success
            cls.pull(node, tool)
            tool.reset()
        finally:
            for process in busy:
                process.kill()
                process.wait()
            if recorder:
                recorder.stop()
            live.stop()

    @classmethod
    def pull(cls, node, tool):
        """Move in circles while gravity changes, and cut the tissue on the way."""
        change = rospy.ServiceProxy(NAMESPACE + "sim/set_parameters", Reconfigure)
        front, step = node.front(), Latest("step", Step)
        tool.appear(front)
        wait_for(lambda: node.contact.fresh().touching, "the tool to touch")
        tool.take_hold(node.contact)
        begin, is_cut = step.fresh().sequence, False
        while step.message.sequence < begin + TURNS:
            if not is_cut and step.message.sequence > begin + TURNS // 3:
                answer = call("cut", CutLine, Header(frame_id="tissue"),
                              [Point(0.02, -0.2, 0.05), Point(0.2, -0.2, 0.05)], Vector3(0, 0.25, 0))
                assert answer.success and answer.severed_area > 1e-3, answer
                is_cut = True
            angle = 0.03 * (step.message.sequence - begin)
            tool.position = list(front + [0.05 * math.sin(angle), -0.05 * math.sin(0.5 * angle) ** 2,
                                          0.02 * math.sin(2 * angle)])
            if step.message.sequence > begin + TURNS // 2:
                change(Config(doubles=[DoubleParameter("gravity_z", 15 * math.sin(angle))]))
            time.sleep(0.01)
        step.close()

    def run_bag(self, *arguments):
        done = subprocess.run(["pliant_bag"] + list(arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              universal_newlines=True, timeout=4 * SECONDS)
        return done.returncode, done.stdout, done.stderr

    def simulate(self, bag, *arguments):
        return self.run_bag(bag, "--scan", SCAN, "--scene", self.scene, "--simulate", *arguments)

    def rewritten(self, name, change, turns):
        """Write a bag with the first steps after the reset, each one changed; None: omitted."""
        path = self.folder + "/" + name
        with rosbag.Bag(self.bag) as source, rosbag.Bag(path, "w") as out:
            begun = False
            for topic, message, when in source.read_messages([NAMESPACE + name
                                                              for name in ("session", "mesh/topology", "step")]):
                if topic == NAMESPACE + "step":
                    begun = begun or message.sequence == 1
                    if not begun or message.sequence > turns:
                        continue
                    message = change(message)
                if message is not None:
                    out.write(topic, message, when)
        return path

    def test_what_is_told_to_stop_ends_within_a_second(self):
        for number, words in ((signal.SIGTERM, ["--simulate"]),
                              (signal.SIGINT, ["--every", "0.01", "--out", self.folder + "/stopped"])):
            process = subprocess.Popen(["pliant_bag", self.bag, "--scan", SCAN, "--scene", self.scene] + words,
                                       stderr=subprocess.PIPE, universal_newlines=True)
            self.addCleanup(process.wait)
            self.addCleanup(process.kill)
            while not re.search("steps|volumes", process.stderr.readline()):
                self.assertIsNone(process.poll())
            code, seconds = stopped.stop(process, number)
            self.assertEqual(code, 130)
            self.assertLess(seconds, 1)

    def test_every_turn_is_recorded(self):
        first = [step.sequence for step in self.steps].index(1)
        numbers = [step.sequence for step in self.steps[first:]]
        self.assertEqual(numbers, list(range(1, len(numbers) + 1)))
        self.assertGreaterEqual(len(numbers), TURNS)
        with rosbag.Bag(self.bag) as bag:
            states = bag.get_message_count(NAMESPACE + "mesh/state")
        self.assertGreater(len(self.steps), states, "states are fewer than steps")

    def test_what_arrived_live_is_put_to_use_where_it_was(self):
        self.assertGreater(len([step for step in self.steps if step.background]), 3, "factors came in")
        code, printed, errors = self.simulate(self.bag)
        self.assertEqual(code, 0, errors)
        self.assertIn("each bitwise equal to the recording", printed)

    def test_it_matters_when_it_arrives(self):
        before, first = [0], [step.sequence for step in self.steps].index(1)
        arrived = [step.sequence for step in self.steps[first:] if step.background]

        def later(step):
            """Delay the background result of each step by one step."""
            step.background, before[0] = before[0], step.background
            return step
        code, _, errors = self.simulate(self.rewritten("late.bag", later, arrived[3] + 10))
        self.assertEqual(code, 1)
        self.assertIn("differ from the recording, from step", errors)

    def test_a_gap_is_told(self):
        code, _, errors = self.simulate(self.rewritten("gap.bag", lambda step: None if step.sequence == 40 else step,
                                                       50))
        self.assertEqual(code, 1)
        self.assertIn("after sequence number 39 the recording continues with 41", errors)

    def test_another_tool_motion_differs(self):
        first = [step.sequence for step in self.steps].index(1)
        grasp = next(step.sequence for step in self.steps[first:] if step.tools[0].closes)

        def shifted(step):
            if step.sequence > grasp:
                step.tools[0].tip = [step.tools[0].tip[0] + 1e-9] + list(step.tools[0].tip[1:])
            return step
        code, _, errors = self.simulate(self.rewritten("shifted.bag", shifted, grasp + 30))
        self.assertEqual(code, 1)
        self.assertIn("differ from the recording, from step", errors)

    def test_replay_simulates_faster_than_live(self):
        launch = Launch("replay.launch", bag=self.bag, scan=SCAN, scene=self.scene, rate="4", simulate="true")
        try:
            wait_for(lambda: "play-" in launch.log() and "finished cleanly" in launch.log(), "the end of the bag",
                     2 * SECONDS)
        finally:
            launch.stop()
        self.assertIn("each bitwise equal to the recording", launch.log())

    def test_replay_goes_on_from_any_point(self):
        """Start after the cut: the replay recomputes the steps from the reset on, and shows states with the topology
        of that time."""
        with rosbag.Bag(self.bag) as bag:
            start, times = bag.get_start_time(), {}
            for topic, message, when in bag.read_messages([NAMESPACE + "step", NAMESPACE + "mesh/state"]):
                times.setdefault(topic, []).append((when.to_sec() - start, message))
            cut = min(when.to_sec() - start for _, message, when in bag.read_messages(NAMESPACE + "mesh/topology")
                      if message.severed)
        self.assertTrue(any(step.cuts for _, step in times[NAMESPACE + "step"]))
        after = [(when, message) for when, message in times[NAMESPACE + "mesh/state"] if when > cut + 0.2]
        self.assertGreater(len(after), 3, "states after the cut")
        reset = [step.sequence for _, step in times[NAMESPACE + "step"]].index(1)
        steps = [when for when, _ in times[NAMESPACE + "step"][reset:]]
        # in the middle of the longest time between two steps, rounded first, so that player and replay agree on the set
        # of steps
        low, high = after[len(after) // 4][0], after[-1 - len(after) // 4][0]
        length, middle = max((next_one - one, 0.5 * (one + next_one)) for one, next_one in zip(steps, steps[1:])
                             if low < one and next_one < high)
        self.assertGreater(length, 0.01, "time between two steps")
        begin = round(middle, 4)
        before = sum(when < begin for when in steps)
        for simulate in ("true", "false"):
            launch = Launch("replay.launch", bag=self.bag, scan=SCAN, rate="2", simulate=simulate, start="%.4f" % begin)
            try:
                wait_for(lambda: "play-" in launch.log() and "finished cleanly" in launch.log(), "the end of the bag",
                         2 * SECONDS)
            finally:
                launch.stop()
            # messages pending at the end of playback may be lost
            shown, dropped = (int(number) for number in re.search(r"(\d+) states shown, (\d+) dropped",
                                                                  launch.log()).groups())
            self.assertGreater(shown, 0)
            self.assertEqual(dropped, 0)
            if simulate == "true":
                made = int(re.search(r"(\d+) steps recomputed, each bitwise equal to the recording",
                                     launch.log()).group(1))
                self.assertEqual(made, before + shown)

    def test_arrays_of_the_last_episode(self):
        code, _, errors = self.run_bag(self.bag, "--export", "numpy", "--rate", "50", "--out", self.folder + "/arrays")
        self.assertEqual(code, 0, errors)
        state, action, steps, episodes = (np.load("%s/arrays/%s.npy" % (self.folder, name))
                                          for name in ("state", "action", "steps", "episodes"))
        rows = episodes == episodes[-1]
        begin = max(i for i, step in enumerate(self.steps) if step.sequence == 1)
        tools = {step.step: step.tools[0] for step in self.steps[begin:]}
        self.assertGreater(np.count_nonzero(rows), 50)
        for number, now in zip(steps[rows], state[rows]):
            told = tools[number]
            self.assertEqual(list(now[:9]), list(told.tip) + list(told.rotation) + [told.jaw, told.closed]
                             if told.present else [0] * 9)
        np.testing.assert_array_equal(action[rows][:-1], state[rows][1:, :10])
        holds = (state[rows][:, 10:13] == 1).all(axis=1)
        self.assertGreater(np.count_nonzero(holds), 10)
        self.assertGreater(np.linalg.norm(state[rows][holds][:, 13:16], axis=1).max(), 0.01)  # it pulls [N]

    def test_table_of_steps(self):
        path = self.folder + "/steps.csv"
        code, _, errors = self.run_bag(self.bag, "--steps", path)
        self.assertEqual(code, 0, errors)
        with open(path) as file:
            rows = list(csv.DictReader(file))
        self.assertEqual([int(row["sequence"]) for row in rows], [step.sequence for step in self.steps])
        self.assertEqual([int(row["checksum"], 16) for row in rows], [step.checksum for step in self.steps])
        self.assertGreater(float(rows[-1]["solve_s"]), 0)


if __name__ == "__main__":
    rostest.rosrun("pliant", "rerun", RerunTest)
