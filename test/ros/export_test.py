#!/usr/bin/env python3
"""Check every number that pliant_bag --export writes from a bag, without a master."""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import rosbag
import rospy
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from pliant.msg import ContactState, Step, ToolInput
from sensor_msgs.msg import Image

try:
    import pyarrow.parquet
    has_pyarrow = True
except ImportError:
    has_pyarrow = False

START, RATE = 1000.0, 10
MOTION = ["x", "y", "z", "qx", "qy", "qz", "qw", "jaw", "closed", "cutting"]
SENSE = ["present", "touching", "grasped", "force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z"]


def step_time(n):
    """Return the time of a step at 100 Hz. One step begins the second episode. Later steps are early, so no table
    row has their time."""
    return 0.2 + 0.01 * n - (0.002 if n > 130 else 0)


def picture_time(n):
    """Return the time of a picture at 10 Hz. All pictures after the first are early."""
    return 0.315 + 0.1 * n - (0.002 if n > 0 else 0)


def tool(name, t, present=True):
    return ToolInput(name=name, present=present, tip=[t, 2 * t, -t], rotation=[0, 0.6, 0, 0.8], jaw=0.1 * t,
                     closed=t > 1, cuts=t < 0.5)


def picture(t, colours):
    """Return a 4 x 6 picture of this time, with four extra bytes per line."""
    size = 3 if colours else 1
    pixels = np.full((4, 6 * size + 4), 255, np.uint8)
    pixels[:, :6 * size] = (np.arange(24 * size) + 10 * t).reshape(4, -1)
    return Image(height=4, width=6, encoding="bgr8" if colours else "8UC1", step=pixels.shape[1], data=pixels.tobytes())


class Export(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp()
        cls.bag = cls.folder + "/session.bag"
        with rosbag.Bag(cls.bag, "w") as bag:
            def write(topic, t, message):
                bag.write(topic, message, rospy.Time.from_sec(START + t))
            write("/tissue/state", 0, Wrench())
            for n in range(200):  # after a reset at 1.5 s the other tool is absent
                t, first = step_time(n), n < 130
                tools = [tool("grasper", t), tool("/PSM1", t, first)]
                write("/tissue/step", t, Step(step=n if first else n - 130, sequence=(n if first else n - 130) + 1,
                                              tools=tools))
                write("/tissue/grasper/body/measured_cf", t,
                      WrenchStamped(wrench=Wrench(Vector3(t, 0, 5), Vector3(0, -t, 1))))
                if n % 3 == 0:
                    write("/PSM1/body/measured_cf", t, WrenchStamped(wrench=Wrench(Vector3(0, n, 0), Vector3())))
                    write("/tissue/grasper/contact", t, ContactState(tool="grasper", touching=True, grasped=n > 60))
            for n in range(20):
                t = picture_time(n)
                write("/tissue/eye/left/image_raw", t, picture(n, True))
                write("/tissue/eye/left/label/image_raw", t, picture(n, False))
                write("/other/image_raw", t, Image(height=1, width=1, encoding="16UC1", step=2, data=b"ab"))

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def run_bag(self, *arguments):
        environment = dict(os.environ, PATH=os.path.dirname(sys.executable) + ":" + os.environ["PATH"])
        done = subprocess.run(["pliant_bag", self.bag] + list(arguments), stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, universal_newlines=True,
                              env=environment, timeout=60)
        return done.returncode, done.stdout, done.stderr

    def assert_arrays(self, folder):
        array = {name[:-4]: np.load(folder + "/" + name) for name in os.listdir(folder) if name.endswith(".npy")}
        self.assertEqual(sorted(array), ["action", "episodes", "image_eye_left", "image_eye_left_label",
                                         "index_eye_left", "index_eye_left_label", "state", "steps", "times"])
        with open(folder + "/columns.json") as file:
            columns = json.load(file)
        self.assertEqual(columns["state"], [name + "/" + each for name in ("grasper", "/PSM1")
                                            for each in MOTION + SENSE])
        self.assertEqual(columns["action"], [name + "/" + each for name in ("grasper", "/PSM1") for each in MOTION])
        # from the first picture to the last step before the reset, and from there to the end
        times = np.concatenate([0.315 + 0.1 * np.arange(12), 1.5 + 0.1 * np.arange(7)])
        np.testing.assert_allclose(array["times"], times, atol=1e-6)
        np.testing.assert_array_equal(array["episodes"], [0] * 12 + [1] * 7)
        newest = np.searchsorted([step_time(n) for n in range(200)], times + 1e-6) - 1
        np.testing.assert_array_equal(array["steps"], np.where(newest < 130, newest, newest - 130))
        for row, n in enumerate(newest):
            t, first = step_time(n), n < 130
            motion = [t, 2 * t, -t, 0, 0.6, 0, 0.8, 0.1 * t, t > 1, t < 0.5]
            grasper = motion + [1, 1, n // 3 * 3 > 60, t, 0, 5, 0, -t, 1]
            other = motion + [1, 0, 0, 0, n // 3 * 3, 0, 0, 0, 0] if first else [0] * 19
            np.testing.assert_allclose(array["state"][row], grasper + other, atol=1e-12)
        for row in range(19):  # the next row's motion; the last row of an episode repeats its own
            then = array["state"][row if row in (11, 18) else row + 1].reshape(2, -1)[:, :10]
            np.testing.assert_array_equal(array["action"][row], then.ravel())
        for name in ("eye_left", "eye_left_label"):  # each picture once
            self.assertEqual(len(array["image_" + name]), array["index_" + name].max() + 1)
            self.assertEqual(len(np.unique(array["image_" + name], axis=0)), len(array["image_" + name]))
        for row, t in enumerate(times):
            seen = np.arange(72).reshape(4, 6,
                                         3) + 10 * (np.searchsorted([picture_time(n) for n in range(20)], t + 1e-6) - 1)
            # red first
            np.testing.assert_array_equal(array["image_eye_left"][array["index_eye_left"][row]], seen[:, :, ::-1])
            np.testing.assert_array_equal(array["image_eye_left_label"][array["index_eye_left_label"][row]],
                                          seen.reshape(-1)[:24].reshape(4, 6))
        return array

    def test_arrays_are_the_bag(self):
        code, printed, errors = self.run_bag("--export", "numpy", "--rate", str(RATE), "--out", self.folder + "/arrays")
        self.assertEqual(code, 0, errors)
        self.assertIn("19 rows of 2 episodes, 2 tools and 2 cameras", printed)
        self.assert_arrays(self.folder + "/arrays")

    def test_a_picture_that_many_rows_show_is_stored_once(self):
        folder = self.folder + "/often"
        code, _, errors = self.run_bag("--export", "numpy", "--rate", "200", "--out", folder)
        self.assertEqual(code, 0, errors)
        times, pictures, index = (np.load(folder + "/%s.npy" % name)
                                  for name in ("times", "image_eye_left", "index_eye_left"))
        self.assertGreater(len(times), 300)
        self.assertEqual([len(pictures), len(index)], [19, len(times)])  # the last of 20 is after the last step
        newest = np.searchsorted([picture_time(n) for n in range(20)], times + 1e-6) - 1
        np.testing.assert_array_equal(pictures[index][:, 0, 0, 2], 10 * newest)

    def test_lerobot_has_its_layout_or_says_what_is_missing(self):
        folder = self.folder + "/dataset"
        code, printed, errors = self.run_bag("--export", "lerobot", "--rate", str(RATE), "--task", "retract", "--out",
                                          folder)
        array = self.assert_arrays(folder + "/numpy")
        if not has_pyarrow:
            self.assertEqual(code, 1, printed)
            self.assertIn("pip install numpy pyarrow", errors)
            return
        self.assertEqual(code, 0, errors)
        with open(folder + "/meta/info.json") as file:
            info = json.load(file)
        self.assertEqual([info[key] for key in ("codebase_version", "fps", "total_episodes", "total_frames")],
                         ["v2.1", RATE, 2, 19])
        lines = {}
        for name in ("episodes", "episodes_stats", "tasks"):
            with open(folder + "/meta/%s.jsonl" % name) as file:
                lines[name] = [json.loads(line) for line in file]
        self.assertEqual(lines["episodes"], [{"episode_index": e, "tasks": ["retract"], "length": n}
                                             for e, n in ((0, 12), (1, 7))])
        self.assertEqual(lines["tasks"], [{"task_index": 0, "task": "retract"}])
        key, begin = "observation.images.eye_left", 0
        for episode, length in enumerate((12, 7)):
            where = {"episode_chunk": 0, "episode_index": episode, "video_key": key}
            table = pyarrow.parquet.read_table(folder + "/" + info["data_path"].format(**where)).to_pydict()
            rows = slice(begin, begin + length)
            np.testing.assert_array_equal(np.array(table["observation.state"], np.float32),
                                          array["state"][rows].astype(np.float32))
            np.testing.assert_array_equal(np.array(table["action"], np.float32),
                                          array["action"][rows].astype(np.float32))
            np.testing.assert_allclose(table["timestamp"], np.arange(length) / RATE, atol=1e-6)
            self.assertEqual(table["index"], list(range(begin, begin + length)))
            self.assertEqual([set(table["episode_index"]), set(table["task_index"])], [{episode}, {0}])
            stats = lines["episodes_stats"][episode]["stats"]
            self.assertEqual(set(stats), set(info["features"]))
            np.testing.assert_allclose(stats["action"]["mean"], array["action"][rows].mean(axis=0), atol=1e-6)
            self.assertEqual(np.shape(stats[key]["max"]), (3, 1, 1))
            if info["features"][key]["dtype"] == "video":
                self.assertGreater(os.path.getsize(folder + "/" + info["video_path"].format(**where)), 100)
            else:
                self.assert_png(table[key][-1]["bytes"], array["image_eye_left"][array["index_eye_left"][rows][-1]])
            begin += length
        code, _, errors = self.run_bag("--export", "lerobot", "--out", folder)
        self.assertEqual(code, 1)
        self.assertIn("holds a dataset already", errors)

    def assert_png(self, data, pixels):
        try:
            import io
            import PIL.Image
        except ImportError:
            return
        np.testing.assert_array_equal(np.array(PIL.Image.open(io.BytesIO(data))), pixels)

    def test_what_is_wrong_is_told(self):
        out = ["--out", self.folder + "/none"]
        for code, words, arguments in ((2, "numpy or lerobot", ["--export", "csv"] + out),
                                       (2, "--out", ["--export", "numpy"]),
                                       (2, "--rate", ["--export", "numpy", "--rate", "0.5"] + out),
                                       (2, "--at", ["--export", "numpy", "--at", "1"] + out),
                                       (1, "--ns", ["--export", "numpy", "--ns", "other"] + out)):
            found, _, errors = self.run_bag(*arguments)
            self.assertEqual(found, code, errors)
            self.assertIn(words, errors)


if __name__ == "__main__":
    unittest.main()
