#!/usr/bin/env python3
"""Record and replay a session: the replayed volumes have the checksums of the live volumes."""
import bisect
import os
import shutil
import subprocess
import sys
import threading
import unittest
import zlib

import numpy
import rosbag
import rospy
import rostest
from pliant.msg import SimState, Volume

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from node_client import NAMESPACE, Latest, Launch, is_sent, nifti_voxels, wait_for  # noqa: E402

SCAN = "phantom:72x48x60"
SECONDS = 60.0  # time limit on a busy machine


class Checksums:
    """Checksums of whole volumes, assembled from boxes, in the order of their time stamps."""

    def __init__(self):
        self.voxels, self.seen, self.sizes, self.gaps, self.last = None, [], set(), 0, None
        self.lock = threading.Lock()
        self.subscriber = rospy.Subscriber(NAMESPACE + "volume", Volume, self.take, buff_size=1 << 27)

    def take(self, message):
        box = numpy.frombuffer(message.data, dtype=numpy.int16).reshape(tuple(reversed(message.size)))
        with self.lock:
            if self.last is not None and message.sequence != self.last + 1:
                self.gaps += 1
            self.last = message.sequence
            if message.size == message.full_size:
                self.voxels = box.copy()
            else:
                (i, j, k), size = message.offset, message.size
                self.voxels[k:k + size[2], j:j + size[1], i:i + size[0]] = box
            entry = [message.header.stamp.to_nsec(), zlib.crc32(self.voxels.tobytes())]
            if self.seen and self.seen[-1][0] == entry[0]:
                self.seen[-1] = entry  # one more box of the same volume
            else:
                self.seen.append(entry)
            self.sizes.add(tuple(message.full_size))

    def all(self):
        with self.lock:
            return [tuple(entry) for entry in self.seen]

    def close(self):
        self.subscriber.unregister()


def write_scene(path):
    """Write the demo scene with a small margin and a strong grasp, so that the pulled tissue leaves the grid."""
    launch = subprocess.check_output(["rospack", "find", "pliant"], universal_newlines=True).strip() + "/launch"
    with open(launch + "/scenes/demo.yaml") as file:
        text = file.read().replace("../materials", launch + "/materials").replace("stiffness: 500", "stiffness: 5000")
    with open(path, "w") as file:
        file.write(text + "warp:\n  margin: 0.012\n  rate: 20\n")


def write_path(path):
    """Write a path that moves in and out within two seconds, so that all volumes differ."""
    with open(path, "w") as file:
        file.write("tools:\n  - name: grasper\n    grasp: [-0.054, -0.063, 0.063]\n    motion:\n"
                   "      - {time: 0.0, offset: [0, 0, 0]}\n      - {time: 1.0, offset: [0, -0.06, 0]}\n"
                   "      - {time: 2.0, offset: [0.01, 0, 0]}\n")


class ReplayTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("replay_test")
        cls.folder = rospy.get_param("~folder")
        shutil.rmtree(cls.folder, ignore_errors=True)
        os.makedirs(cls.folder)
        cls.bag, cls.scene = cls.folder + "/session.bag", cls.folder + "/scene.yaml"
        write_scene(cls.scene)
        write_path(cls.folder + "/path.yaml")
        cls.record()

    @classmethod
    def record(cls):
        """Record a cycle of the scripted tool. cls.live contains the volumes that the recording surely includes."""
        # a replay contains every change; a live volume contains changes below the scan's noise only at rest, unless
        # requested
        with open(cls.folder + "/params.yaml", "w") as file:
            file.write("volume_threshold: 0\n")
        live = Launch("scripted.launch", scan=SCAN, scene=cls.scene, path=cls.folder + "/path.yaml",
                      params=cls.folder + "/params.yaml")
        state, volumes = Latest("state", SimState), Checksums()
        recorder = None
        try:
            wait_for(lambda: state.message and state.message.state == SimState.RUNNING, "steps", SECONDS)
            recorder = Launch("record.launch", bag=cls.bag)
            for topic in ("mesh/topology", "mesh/state"):
                wait_for(lambda: is_sent("sim", topic, "/record_tissue"), "the recorder", SECONDS)
            begin = len(volumes.all())
            wait_for(lambda: len(set(crc for _, crc in volumes.all()[begin:])) > 40, "many volumes", SECONDS)
            seen = volumes.all()[begin:]
        finally:
            if recorder:
                recorder.stop()
            live.stop()
            volumes.close()
            state.close()
        assert volumes.gaps == 0
        assert len(volumes.sizes) == 1  # the grid has a margin (warp/margin) and stays, although the tissue leaves it
        cls.states = [stamp for stamp, _ in cls.recorded()]
        # messages pending at the start and end of the recording are not in the bag; the tissue moves after the last one
        cls.live = [(stamp, crc) for stamp, crc in seen if cls.states[0] <= stamp <= cls.states[-1]][:-10]

    @classmethod
    def recorded(cls):
        """Return (time stamp of the state [ns], seconds from the start of the bag to its arrival)."""
        with rosbag.Bag(cls.bag) as bag:
            start = bag.get_start_time()
            return [(message.header.stamp.to_nsec(), when.to_sec() - start)
                    for _, message, when in bag.read_messages(NAMESPACE + "mesh/state")]

    def replay(self, until, **arguments):
        """Replay until the condition is true, and return the volumes."""
        volumes = Checksums()
        launch = Launch("replay.launch", bag=self.bag, **dict({"scan": SCAN, "scene": self.scene}, **arguments))
        try:
            wait_for(lambda: until(volumes, launch), "the end of the replay", SECONDS)
        finally:
            launch.stop()
            volumes.close()
        self.assertEqual(volumes.gaps, 0)
        self.assertFalse(rospy.get_param("/use_sim_time", False), "the next node waits for a clock that nobody sends")
        return volumes.all()

    def assert_same(self, replayed, live, before=None):
        """Compare at the time stamp of every live volume. A state without changes sends no volume, so more states
        than live volumes exist. before: checksum of the previous volume; None: there was none, and the first
        state's volume is required."""
        if before is None:
            self.assertEqual(replayed[0][0], self.states[0], "the first states were missed")
        stamps = [stamp for stamp, _ in replayed]
        self.assertEqual(stamps, sorted(stamps))
        self.assertGreater(len(set(stamps) & set(stamp for stamp, _ in live)), 0.7 * len(live))
        checksums = [before] + [crc for _, crc in replayed]
        shown = [checksums[bisect.bisect_right(stamps, stamp)] for stamp, _ in live]
        different = [stamp for (stamp, crc), found in zip(live, shown) if crc != found]
        self.assertEqual(different, [], "of %d live volumes, %d replayed" % (len(live), len(replayed)))

    def has_last(self, volumes, _):
        seen = volumes.all()
        return bool(seen) and max(stamp for stamp, _ in seen) >= self.live[-1][0]

    def test_every_live_volume_has_its_state(self):
        with rosbag.Bag(self.bag) as bag:
            self.assertFalse([topic for topic in bag.get_type_and_topic_info().topics if "volume" in topic])
        states = set(self.states)
        self.assertEqual([stamp for stamp, _ in self.live if stamp not in states], [])

    def test_replay_shows_what_was_live(self):
        self.assertGreater(len(set(crc for _, crc in self.live)), 20)
        self.assert_same(self.replay(self.has_last, sim_time="false", rate="4"), self.live)

    def test_simulated_time_that_is_fast_and_jumps_back(self):
        def played_twice(volumes, _):
            seen = [stamp for stamp, _ in volumes.all()]
            back = [i for i in range(1, len(seen)) if seen[i] < seen[i - 1] - 10 ** 9]
            return bool(back) and max(seen[back[0]:]) >= self.live[-1][0]
        replayed = self.replay(played_twice, rate="4", loop="true", sim_time="true")
        stamps = [stamp for stamp, _ in replayed]
        back = [i for i in range(1, len(stamps)) if stamps[i] < stamps[i - 1] - 10 ** 9] + [len(stamps)]
        self.assert_same(replayed[:back[0]], self.live)
        self.assert_same(replayed[back[0]:back[1]], self.live, replayed[back[0] - 1][1])  # a third pass may have begun

    def test_another_mesh_is_refused(self):
        with open(self.scene) as file:
            text = file.read().replace("ratio: 2", "ratio: 1")
        with open(self.folder + "/other.yaml", "w") as file:
            file.write(text)

        def refused(_, launch):
            return "nodes, the model here" in launch.log()
        self.assertEqual(self.replay(refused, scene=self.folder + "/other.yaml"), [])

    # ---- without a master

    def run_bag(self, *arguments):
        done = subprocess.run(["pliant_bag"] + list(arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              universal_newlines=True, timeout=SECONDS)
        return done.returncode, done.stderr

    def test_bag_writes_what_was_live(self):
        live = dict(self.live)
        states = self.recorded()
        # some live states that the next state does not follow immediately
        chosen = [(stamp, when + 1e-3) for (stamp, when), (_, after) in zip(states, states[1:])
                  if stamp in live and after > when + 3e-3]
        chosen = chosen[::max(1, len(chosen) // 8)]
        self.assertGreater(len(set(live[stamp] for stamp, _ in chosen)), 2)
        folder = self.folder + "/volumes"
        times = ",".join("%.6f" % when for _, when in chosen)
        code, errors = self.run_bag(self.bag, "--scan", SCAN, "--scene", self.scene, "--at", times, "--out", folder)
        self.assertEqual(code, 0, errors)
        for stamp, when in chosen:
            voxels = nifti_voxels("%s/deformed_%08.3f.nii.gz" % (folder, float("%.6f" % when)))
            self.assertEqual(zlib.crc32(voxels.tobytes()), live[stamp])

    def test_bag_writes_at_intervals(self):
        folder = self.folder + "/every"
        code, errors = self.run_bag(self.bag, "--scan", SCAN, "--scene", self.scene, "--every", "1", "--out", folder)
        self.assertEqual(code, 0, errors)
        self.assertIn("deformed_0002.000.nii.gz", os.listdir(folder))

    def test_bag_says_what_is_wrong(self):
        out = ["--out", self.folder + "/none"]
        for code, words, arguments in (
                (2, "--scan", [self.bag, "--at", "1"] + out),
                (2, "--at", [self.bag, "--scan", SCAN] + out),
                (2, "expected seconds", [self.bag, "--scan", SCAN, "--at", "1,x"] + out),
                (1, "choose times in there", [self.bag, "--scan", SCAN, "--scene", self.scene, "--at", "1000"] + out),
                (1, "differ from the voxels of the recording",
                 [self.bag, "--scan", "phantom:64x48x56", "--scene", self.scene, "--at", "2"] + out),
                (1, "--ns", [self.bag, "--scan", SCAN, "--ns", "other", "--at", "2"] + out),
                (1, "none.bag", [self.folder + "/none.bag", "--scan", SCAN, "--at", "2"] + out)):
            found, errors = self.run_bag(*arguments)
            self.assertEqual(found, code, errors)
            self.assertIn(words, errors)


if __name__ == "__main__":
    rostest.rosrun("pliant", "replay", ReplayTest)
