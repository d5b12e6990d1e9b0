#!/usr/bin/env python3
"""Read datasets of pliant_lerobot by the paths, indices and types in the dataset, as LeRobot's reader does. If
LeRobot is installed, it reads them too. Without pyarrow a stand-in stores the tables, so the test covers their
contents, but not the parquet format."""
import json
import os
import runpy
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

import numpy as np

PROGRAM = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "src", "python", "lerobot.py")
LENGTHS, FPS, CAMERA = (15, 10), 10, "observation.images.eye_left"
STAND_IN = """
import pickle, sys, types
def array(values, kind=None): return getattr(values, "tolist", lambda: values)()
def struct(fields): return fields
def binary(): return "binary"
def string(): return "string"
class FixedSizeListArray:
    @staticmethod
    def from_arrays(values, size): return [values[n:n + size] for n in range(0, len(values), size)]
class Table:
    def __init__(self, columns, metadata=None):
        self.columns, self.schema = columns, types.SimpleNamespace(metadata=metadata)
        assert len({len(each) for each in columns.values()}) == 1, "columns of different lengths"
    def replace_schema_metadata(self, metadata):
        return Table(self.columns, {name.encode(): value for name, value in metadata.items()})
    def column(self, name): return types.SimpleNamespace(to_pylist=lambda: self.columns[name])
    def to_pydict(self): return self.columns
    def to_pylist(self): return [dict(zip(self.columns, row)) for row in zip(*self.columns.values())]
    @staticmethod
    def from_pylist(rows): return Table({name: [row[name] for row in rows] for name in rows[0]})
table = Table
def _write(table, path, dictionary_pagesize_limit=0):
    with open(path, "wb") as file: pickle.dump((table.columns, table.schema.metadata), file)
def _read(path):
    with open(path, "rb") as file: return Table(*pickle.load(file))
parquet = sys.modules["pyarrow.parquet"] = types.SimpleNamespace(write_table=_write, read_table=_read)
"""
try:
    import pyarrow.parquet
    beside = None
except ImportError:
    for name in [name for name in sys.modules if name.split(".")[0] == "pyarrow"]:
        del sys.modules[name]  # it has no parquet module
    beside = tempfile.TemporaryDirectory()
    with open(os.path.join(beside.name, "pyarrow.py"), "w") as stand_in:
        stand_in.write(STAND_IN)
    sys.path.insert(0, beside.name)
    os.environ["PYTHONPATH"] = os.pathsep.join([beside.name] +
                                               [path for path in [os.environ.get("PYTHONPATH")] if path])
    import pyarrow.parquet
try:
    os.environ.update(HF_HUB_OFFLINE="1", HF_DATASETS_OFFLINE="1")
    from lerobot.datasets.lerobot_dataset import CODEBASE_VERSION, LeRobotDataset
except ImportError:
    CODEBASE_VERSION = None


class LeRobot(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.addCleanup(self.temporary.cleanup)
        self.arrays, random, rows = os.path.join(self.temporary.name, "arrays"), np.random.default_rng(1), sum(LENGTHS)
        os.makedirs(self.arrays)
        pictures = np.zeros((rows, 7, 9, 3), np.uint8)  # an odd size selects png, with or without ffmpeg
        pictures[...] = 10 * np.arange(rows)[:, None, None, None]
        pictures[:, :4, :, 0] = 200
        self.array = {"episodes": np.repeat([0, 1], LENGTHS), "state": random.normal(size=(rows, 19)),
                      "action": random.normal(size=(rows, 10)),
                      "image_eye_left": pictures, "index_eye_left": np.arange(rows) // 4}  # four rows show each picture
        pictures = self.array["image_eye_left"] = pictures[::4].copy()
        for name, each in self.array.items():
            np.save(os.path.join(self.arrays, name + ".npy"), each)
        with open(os.path.join(self.arrays, "columns.json"), "w") as file:
            json.dump({"state": ["s%d" % n for n in range(19)], "action": ["a%d" % n for n in range(10)],
                       "images": ["eye_left"], "fps": FPS}, file)

    def make(self, layout):
        folder = os.path.join(self.temporary.name, "dataset" + layout)
        subprocess.run([sys.executable, PROGRAM, self.arrays, folder, "--task", "retract", "--layout", layout],
                       check=True, timeout=60)
        with open(os.path.join(folder, "meta", "info.json")) as file:
            info = json.load(file)
        self.assertEqual([info["codebase_version"], info["fps"], info["total_episodes"], info["total_frames"]],
                         ["v" + layout, FPS, 2, 25])
        return folder, info

    def assert_rows(self, folder, name, begin, length, episode):
        table = pyarrow.parquet.read_table(os.path.join(folder, name))
        self.assertIn(b"huggingface", table.schema.metadata)
        rows, columns = slice(begin, begin + length), table.to_pydict()
        np.testing.assert_array_equal(np.array(columns["observation.state"], np.float32),
                                      self.array["state"][rows].astype(np.float32))
        np.testing.assert_array_equal(np.array(columns["action"], np.float32),
                                      self.array["action"][rows].astype(np.float32))
        self.assertEqual([columns["index"], set(columns["episode_index"])],
                         [list(range(begin, begin + length)), {episode}])
        png, index = runpy.run_path(PROGRAM)["png"], self.array["index_eye_left"][rows]
        self.assertEqual([each["bytes"] for each in columns[CAMERA]],
                         [png(self.array["image_eye_left"][n]) for n in index])

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
            np.testing.assert_allclose(stats["action"][name],
                                       getattr(self.array["action"].astype(np.float32), name)(axis=0), rtol=1e-5)
        self.assert_lerobot_reads(folder, info)

    def test_a_line_an_episode_tells_where_it_is(self):
        folder, info = self.make("2.1")
        with open(os.path.join(folder, "meta/episodes.jsonl")) as file:
            rows, begin = [json.loads(line) for line in file], 0
        for row in rows:
            self.assert_rows(folder, info["data_path"].format(episode_chunk=0, episode_index=row["episode_index"]),
                             begin, row["length"], row["episode_index"])
            begin += row["length"]
        self.assertEqual(begin, 25)
        self.assert_lerobot_reads(folder, info)

    @unittest.skipIf(beside, "pyarrow is missing")
    def test_a_picture_that_many_rows_show_is_stored_once(self):
        # noise: a png has the size of the array
        pictures = np.random.default_rng(2).integers(0, 255, (7, 301, 301, 3), np.uint8)
        np.save(os.path.join(self.arrays, "image_eye_left.npy"), pictures)
        folder = self.make("2.1")[0]
        size = sum(os.path.getsize(os.path.join(place, name)) for place, _, names in os.walk(folder) for name in names)
        # one picture per row would give 3.6; both episodes store one common picture
        self.assertLess(size, 1.3 * pictures.nbytes)

    def test_what_is_missing_is_told_before_anything_is_written(self):
        folder = os.path.join(self.temporary.name, "none")
        for missing in ("pyarrow", "numpy"):
            hidden = ("import runpy, sys; sys.modules[%r] = None; sys.argv = sys.argv[1:]; "
                      "runpy.run_path(sys.argv[0], run_name='__main__')") % missing
            told = subprocess.run([sys.executable, "-c", hidden, PROGRAM, self.arrays, folder], stderr=subprocess.PIPE,
                                  universal_newlines=True, timeout=60)
            self.assertEqual([told.returncode, told.stderr],
                             [1, "%s is missing: pip install %s\n" % (missing, missing)])
        self.assertFalse(os.path.exists(folder))

    def test_statistics_of_episodes_are_those_of_all(self):
        program, parts = runpy.run_path(PROGRAM), np.split(self.array["state"], [LENGTHS[0]])
        told = program["together"]([program["statistics"](part) for part in parts])
        self.assertEqual(told["count"], [25])
        for name in ("min", "max", "mean", "std"):
            np.testing.assert_allclose(told[name], getattr(self.array["state"], name)(axis=0), rtol=1e-12)
        pictures = program["statistics"](program["Pictures"](self.array["image_eye_left"],
                                                             self.array["index_eye_left"]))
        np.testing.assert_allclose(pictures["mean"],
                                   self.array["image_eye_left"][self.array["index_eye_left"]].mean(
                                       axis=(0, 1, 2)).reshape(3, 1, 1) / 255)

    def test_pictures_are_png(self):
        picture = self.array["image_eye_left"][3]
        data = runpy.run_path(PROGRAM)["png"](picture)
        self.assertEqual([data[:8], struct.unpack(">II", data[16:24]), data[24:29]],
                         [b"\x89PNG\r\n\x1a\n", (9, 7), bytes([8, 2, 0, 0, 0])])
        length = struct.unpack(">I", data[33:37])[0]
        self.assertEqual([data[37:41], zlib.crc32(data[37:41 + length])],
                         [b"IDAT", struct.unpack(">I", data[41 + length:45 + length])[0]])
        lines = np.frombuffer(zlib.decompress(data[41:41 + length]), np.uint8).reshape(7, 28)
        self.assertFalse(lines[:, 0].any())  # no filter
        np.testing.assert_array_equal(lines[:, 1:].reshape(7, 9, 3), picture)

    def assert_lerobot_reads(self, folder, info):
        if info["codebase_version"] != CODEBASE_VERSION:
            return
        told = LeRobotDataset("pliant/session", root=folder, delta_timestamps={"action": [0, 1 / FPS]})
        self.assertEqual([told.num_episodes, len(told)], [2, 25])
        for row in (0, 14, 24):
            each, then = told[row], row if row in (14, 24) else row + 1
            np.testing.assert_array_equal(each["observation.state"].numpy(),
                                          self.array["state"][row].astype(np.float32))
            np.testing.assert_array_equal(each["action"].numpy(), self.array["action"][[row, then]].astype(np.float32))
            np.testing.assert_array_equal(np.round(255 * each[CAMERA].numpy()),
                                          self.array["image_eye_left"][self.array["index_eye_left"][row]].transpose(
                                              2, 0, 1))
            self.assertEqual(each["task"], "retract")


if __name__ == "__main__":
    unittest.main()
