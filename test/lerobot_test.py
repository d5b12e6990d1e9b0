#!/usr/bin/env python3
"""pliant_lerobot, read back as LeRobot's reader does: by the paths, indices and types that the dataset itself tells. Where LeRobot is installed, by it."""
import json
import os
import subprocess
import sys
import tempfile
import unittest

import numpy as np

PROGRAM = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "src", "python", "lerobot.py")
LENGTHS, FPS, CAMERA = (15, 10), 10, "observation.images.eye_left"
try:
    import pyarrow.parquet
except ImportError:
    pyarrow = None
try:
    os.environ.update(HF_HUB_OFFLINE="1", HF_DATASETS_OFFLINE="1")
    from lerobot.datasets.lerobot_dataset import CODEBASE_VERSION, LeRobotDataset
except ImportError:
    CODEBASE_VERSION = None


@unittest.skipUnless(pyarrow, "pyarrow is missing: pip install pyarrow")
class LeRobot(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.addCleanup(self.temporary.cleanup)
        self.arrays, random, rows = os.path.join(self.temporary.name, "arrays"), np.random.default_rng(1), sum(LENGTHS)
        os.makedirs(self.arrays)
        pictures = np.zeros((rows, 7, 9, 3), np.uint8)  # odd: png, whether ffmpeg is installed or not
        pictures[...] = 10 * np.arange(rows)[:, None, None, None]
        pictures[:, :4, :, 0] = 200
        self.array = {"episodes": np.repeat([0, 1], LENGTHS), "state": random.normal(size=(rows, 19)), "action": random.normal(size=(rows, 10)),
                      "image_eye_left": pictures}
        for name, each in self.array.items():
            np.save(os.path.join(self.arrays, name + ".npy"), each)
        with open(os.path.join(self.arrays, "columns.json"), "w") as file:
            json.dump({"state": ["s%d" % n for n in range(19)], "action": ["a%d" % n for n in range(10)], "images": ["eye_left"], "fps": FPS}, file)

    def make(self, layout):
        folder = os.path.join(self.temporary.name, "dataset" + layout)
        subprocess.run([sys.executable, PROGRAM, self.arrays, folder, "--task", "retract", "--layout", layout], check=True, timeout=60)
        with open(os.path.join(folder, "meta", "info.json")) as file:
            info = json.load(file)
        self.assertEqual([info["codebase_version"], info["fps"], info["total_episodes"], info["total_frames"]], ["v" + layout, FPS, 2, 25])
        return folder, info

    def assert_rows(self, folder, name, begin, length, episode):
        table = pyarrow.parquet.read_table(os.path.join(folder, name))
        self.assertIn(b"huggingface", table.schema.metadata)
        rows, columns = slice(begin, begin + length), table.to_pydict()
        np.testing.assert_array_equal(np.array(columns["observation.state"], np.float32), self.array["state"][rows].astype(np.float32))
        np.testing.assert_array_equal(np.array(columns["action"], np.float32), self.array["action"][rows].astype(np.float32))
        self.assertEqual([columns["index"], set(columns["episode_index"])], [list(range(begin, begin + length)), {episode}])
        self.assertTrue(all(each["bytes"].startswith(b"\x89PNG") for each in columns[CAMERA]))

    def test_a_row_an_episode_tells_where_it_is(self):
        folder, info = self.make("3.0")
        rows = pyarrow.parquet.read_table(os.path.join(folder, "meta/episodes/chunk-000/file-000.parquet")).to_pylist()
        self.assertEqual([row["length"] for row in rows], list(LENGTHS))
        for row in rows:
            name = info["data_path"].format(chunk_index=row["data/chunk_index"], file_index=row["data/file_index"])
            self.assertEqual(row["dataset_to_index"] - row["dataset_from_index"], row["length"])
            self.assert_rows(folder, name, row["dataset_from_index"], row["length"], row["episode_index"])
        tasks = pyarrow.parquet.read_table(os.path.join(folder, "meta/tasks.parquet"))
        self.assertEqual(tasks.column("__index_level_0__").to_pylist(), ["retract"])
        with open(os.path.join(folder, "meta/stats.json")) as file:
            stats = json.load(file)
        self.assertEqual(set(stats), set(info["features"]))
        for name in ("min", "max", "mean", "std"):
            np.testing.assert_allclose(stats["action"][name], getattr(self.array["action"].astype(np.float32), name)(axis=0), rtol=1e-5)
        self.assert_lerobot_reads(folder, info)

    def test_a_line_an_episode_tells_where_it_is(self):
        folder, info = self.make("2.1")
        with open(os.path.join(folder, "meta/episodes.jsonl")) as file:
            rows, begin = [json.loads(line) for line in file], 0
        for row in rows:
            self.assert_rows(folder, info["data_path"].format(episode_chunk=0, episode_index=row["episode_index"]), begin, row["length"], row["episode_index"])
            begin += row["length"]
        self.assertEqual(begin, 25)
        self.assert_lerobot_reads(folder, info)

    def assert_lerobot_reads(self, folder, info):
        if info["codebase_version"] != CODEBASE_VERSION:
            return
        told = LeRobotDataset("pliant/session", root=folder, delta_timestamps={"action": [0, 1 / FPS]})
        self.assertEqual([told.num_episodes, len(told)], [2, 25])
        for row in (0, 14, 24):
            each, then = told[row], row if row in (14, 24) else row + 1
            np.testing.assert_array_equal(each["observation.state"].numpy(), self.array["state"][row].astype(np.float32))
            np.testing.assert_array_equal(each["action"].numpy(), self.array["action"][[row, then]].astype(np.float32))
            np.testing.assert_array_equal(np.round(255 * each[CAMERA].numpy()), self.array["image_eye_left"][row].transpose(2, 0, 1))
            self.assertEqual(each["task"], "retract")


if __name__ == "__main__":
    unittest.main()
