#!/usr/bin/env python3
"""Convert the arrays of pliant_bag --export numpy to a dataset in LeRobot's layout (huggingface.co/docs/lerobot):
version 2.1, or 3.0 for LeRobot 0.4 and later.

    pliant_lerobot ARRAYS DATASET [--task TEXT] [--layout 2.1|3.0]

Needs numpy and pyarrow. Colour pictures become mp4 (H.264) if ffmpeg is installed and both sides are even, otherwise
png inside the tables. Label maps and depths stay arrays.
"""
import argparse
import json
import os
import shutil
import struct
import subprocess
import sys
import zlib

try:
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet
except ModuleNotFoundError as missing:
    sys.exit("%s is missing: pip install %s" % (missing.name, missing.name))
except ImportError as wrong:  # installed, but one of its dependencies is missing
    sys.exit(str(wrong))

CHUNK = 1000  # number of episodes per folder
DATA = {"2.1": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "3.0": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"}
VIDEO = {"2.1": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
         "3.0": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"}
INDICES = ("frame_index", "episode_index", "index", "task_index")


def png(picture):
    """Encode an array (height x width x 3) as a png file."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    height, width = picture.shape[:2]
    # each line starts with its filter type: none
    lines = np.concatenate([np.zeros((height, 1), np.uint8), picture.reshape(height, -1)], axis=1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines.tobytes(), 6)) +
            chunk(b"IEND", b""))


def write_video(path, pictures, fps):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    height, width = pictures.shape[1:3]
    encoder = subprocess.Popen(["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s",
                                "%dx%d" % (width, height), "-r",
                                str(fps), "-i", "-", "-c:v", "libx264", "-crf", "18", "-g", "2", "-pix_fmt", "yuv420p",
                                path], stdin=subprocess.PIPE)
    try:
        for picture in pictures:
            encoder.stdin.write(picture.tobytes())
        encoder.stdin.close()
    except BrokenPipeError:
        pass  # ffmpeg has printed the reason
    if encoder.wait() != 0:
        sys.exit("ffmpeg could not write " + path)


class Pictures:
    """Recorded pictures of a camera, and the index of the picture that each row shows. A picture is stored once,
    even if several rows show it."""

    def __init__(self, recorded, index):
        self.recorded, self.index, self.ndim = recorded, index, recorded.ndim
        self.shape = (len(index),) + recorded.shape[1:]

    def __len__(self):
        return len(self.index)

    def __getitem__(self, rows):
        return Pictures(self.recorded, self.index[rows])

    def __iter__(self):
        return (self.recorded[number] for number in self.index)

    def files(self):
        """Yield the picture of each row as png."""
        made = {}
        for number in self.index:
            if number not in made:
                made = {number: png(self.recorded[number])}  # indices ascend, so an earlier picture is not needed again
            yield made[number]


def statistics(values):
    """Return the statistics of one episode. For pictures: per colour channel in [0, 1], over at most 100 pictures
    and about 150 pixels per side."""
    pictures = values.ndim == 4
    if pictures:
        pixels = max(1, max(values.shape[1:3]) // 150)
        few = values[::-(-len(values) // 100)]
        values = few.recorded[few.index][:, ::pixels, ::pixels]
    count = len(values)
    if pictures:
        values = values.reshape(-1, 3) / 255.0
    values = values.reshape(len(values), -1).astype(np.float64)
    out = {name: getattr(values, name)(axis=0) for name in ("min", "max", "mean", "std")}
    if pictures:
        out = {name: value.reshape(3, 1, 1) for name, value in out.items()}
    return dict({name: value.tolist() for name, value in out.items()}, count=[count])


def together(each):
    """Combine the statistics of all episodes."""
    count = np.array([stats["count"][0] for stats in each], np.float64)
    mean, std = (np.array([stats[name] for stats in each]) for name in ("mean", "std"))
    weight = (count / count.sum()).reshape([-1] + [1] * (mean.ndim - 1))
    middle = (weight * mean).sum(axis=0)
    out = {"min": np.min([stats["min"] for stats in each], axis=0),
           "max": np.max([stats["max"] for stats in each], axis=0), "mean": middle,
           "std": np.sqrt((weight * (std ** 2 + (mean - middle) ** 2)).sum(axis=0))}
    return dict({name: value.tolist() for name, value in out.items()}, count=[int(count.sum())])


class Dataset:
    def __init__(self, arrays, folder, task, layout):
        self.arrays, self.folder, self.task, self.layout = arrays, folder, task, layout
        with open(os.path.join(arrays, "columns.json")) as file:
            self.columns = json.load(file)
        self.episodes, self.state, self.action = self.load("episodes"), self.load("state"), self.load("action")
        pictures = {name: self.load_pictures(name) for name in self.columns["images"]}
        self.pictures = {"observation.images." + name: each for name, each in pictures.items() if each.ndim == 4}
        even = [key for key, each in self.pictures.items() if each.shape[1] % 2 == 0 and each.shape[2] % 2 == 0]
        self.videos = even if shutil.which("ffmpeg") else []

    def load(self, name):
        return np.load(os.path.join(self.arrays, name + ".npy"), mmap_mode="r")

    def load_pictures(self, name):
        recorded = self.load("image_" + name)
        # older exports contain one picture per row
        is_indexed = os.path.exists(os.path.join(self.arrays, "index_%s.npy" % name))
        return Pictures(recorded, np.asarray(self.load("index_" + name)) if is_indexed else np.arange(len(recorded)))

    def path(self, name):
        path = os.path.join(self.folder, name)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        return path

    @staticmethod
    def where(episode):
        """Return the values for an episode's file names; every episode has a separate file in both layouts."""
        return {"episode_chunk": episode // CHUNK, "episode_index": episode, "chunk_index": episode // CHUNK,
                "file_index": episode % CHUNK}

    def features(self):
        out = {}
        for key, column, array in (("observation.state", "state", self.state), ("action", "action", self.action)):
            out[key] = {"dtype": "float32", "shape": [array.shape[1]], "names": self.columns[column]}
        for key, each in self.pictures.items():
            out[key] = {"dtype": "image", "shape": list(each.shape[1:]), "names": ["height", "width", "channels"]}
            if key in self.videos:
                height, width, fps = each.shape[1], each.shape[2], self.columns["fps"]
                out[key].update(dtype="video", info={
                    "video.height": height, "video.width": width, "video.fps": fps, "video.channels": 3,
                    "video.codec": "h264",
                    "video.pix_fmt": "yuv420p", "video.is_depth_map": False, "has_audio": False})
        out["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
        out.update({key: {"dtype": "int64", "shape": [1], "names": None} for key in INDICES})
        return out

    def write_episode(self, episode, rows):
        """Write an episode's table and videos, and return its statistics."""
        length = rows.stop - rows.start
        number = np.arange(length)
        values = {"observation.state": self.state[rows].astype(np.float32),
                  "action": self.action[rows].astype(np.float32)}
        values.update({key: each[rows] for key, each in self.pictures.items()})
        values["timestamp"] = (number / self.columns["fps"]).astype(np.float32)
        values.update(zip(INDICES, (number, np.full(length, episode), number + rows.start, np.zeros(length, np.int64))))
        where = self.where(episode)
        columns, kinds = {}, {}  # kinds: metadata for the package `datasets`
        for key, array in values.items():
            if key in self.videos:
                write_video(self.path(VIDEO[self.layout].format(video_key=key, **where)), array, self.columns["fps"])
            elif key in self.pictures:
                files = [{"bytes": each, "path": "frame_%06d.png" % n} for n, each in enumerate(array.files())]
                columns[key] = pa.array(files, pa.struct([("bytes", pa.binary()), ("path", pa.string())]))
                kinds[key] = {"_type": "Image"}
            elif array.ndim == 2:
                columns[key] = pa.FixedSizeListArray.from_arrays(pa.array(array.ravel()), array.shape[1])
                kinds[key] = {"feature": {"dtype": str(array.dtype), "_type": "Value"}, "length": array.shape[1],
                              "_type": "Sequence"}
            else:
                columns[key] = pa.array(array)
                kinds[key] = {"dtype": str(array.dtype), "_type": "Value"}
        table = pa.table(columns).replace_schema_metadata({"huggingface": json.dumps({"info": {"features": kinds}})})
        # equal pictures are stored once, in the column's dictionary of any size
        pa.parquet.write_table(table, self.path(DATA[self.layout].format(**where)), dictionary_pagesize_limit=1 << 30)
        return {key: statistics(array) for key, array in values.items()}

    def write(self):
        if os.path.exists(os.path.join(self.folder, "meta")):
            sys.exit("%s holds a dataset already: name another folder" % self.folder)
        count = int(self.episodes[-1]) + 1
        bounds = np.searchsorted(self.episodes, np.arange(count + 1))
        episodes, stats = [], []
        for episode in range(count):
            rows = slice(int(bounds[episode]), int(bounds[episode + 1]))
            stats.append(self.write_episode(episode, rows))
            episodes.append({"episode_index": episode, "tasks": [self.task], "length": rows.stop - rows.start})
        info = {"codebase_version": "v" + self.layout, "robot_type": "pliant", "total_episodes": count,
                "total_frames": len(self.episodes), "total_tasks": 1,
                "chunks_size": CHUNK, "fps": self.columns["fps"], "splits": {"train": "0:%d" % count},
                "data_path": DATA[self.layout],
                "video_path": VIDEO[self.layout] if self.videos else None, "features": self.features()}
        if self.layout == "2.1":
            info.update(total_videos=count * len(self.videos), total_chunks=(count + CHUNK - 1) // CHUNK)
            self.write_lines("tasks", [{"task_index": 0, "task": self.task}])
            self.write_lines("episodes", episodes)
            self.write_lines("episodes_stats", [{"episode_index": episode, "stats": each}
                                                for episode, each in enumerate(stats)])
        else:
            info.update(data_files_size_in_mb=100, video_files_size_in_mb=500)
            for feature in info["features"].values():
                if feature["dtype"] != "video":
                    feature["fps"] = self.columns["fps"]
            self.write_tables(episodes, stats, bounds)
        with open(self.path("meta/info.json"), "w") as file:
            json.dump(info, file, indent=4)

    def write_lines(self, name, lines):
        with open(self.path("meta/%s.jsonl" % name), "w") as file:
            file.writelines(json.dumps(line) + "\n" for line in lines)

    def write_tables(self, episodes, stats, bounds):
        """Write the tables of layout 3.0: the tasks, in the index format of pandas, and one row per episode with the
        location of its data."""
        index = {"index_columns": ["__index_level_0__"], "column_indexes": [], "pandas_version": "2.0.0", "columns": [
            {"name": None, "field_name": "__index_level_0__", "pandas_type": "unicode", "numpy_type": "object",
             "metadata": None},
            {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64",
             "metadata": None}]}
        tasks = pa.table({"task_index": [0], "__index_level_0__": [self.task]}).replace_schema_metadata(
            {"pandas": json.dumps(index)})
        pa.parquet.write_table(tasks, self.path("meta/tasks.parquet"))
        for row, each in zip(episodes, stats):
            place = self.where(row["episode_index"])
            at = {"/chunk_index": place["chunk_index"], "/file_index": place["file_index"]}
            row.update({"data" + name: value for name, value in at.items()})
            row.update(dataset_from_index=int(bounds[row["episode_index"]]),
                       dataset_to_index=int(bounds[row["episode_index"] + 1]))
            for key in self.videos:
                row.update({"videos/" + key + name: value for name, value in at.items()})
                row.update({"videos/%s/from_timestamp" % key: 0.0,
                            "videos/%s/to_timestamp" % key: row["length"] / self.columns["fps"]})
            row.update({"stats/%s/%s" % (key, name): value for key, of_key in each.items()
                        for name, value in of_key.items()})
            row.update({"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0})
        pa.parquet.write_table(pa.Table.from_pylist(episodes), self.path("meta/episodes/chunk-000/file-000.parquet"))
        with open(self.path("meta/stats.json"), "w") as file:
            json.dump({key: together([each[key] for each in stats]) for key in stats[0]}, file, indent=4)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("arrays", help="folder of pliant_bag --export numpy")
    parser.add_argument("dataset", help="folder to make")
    parser.add_argument("--task", default="tissue", help="what was done, in words")
    parser.add_argument("--layout", choices=sorted(DATA), default="2.1",
                        help="2.1: LeRobot before 0.4; 3.0: from then on")
    arguments = parser.parse_args()
    Dataset(arguments.arrays, arguments.dataset, arguments.task, arguments.layout).write()
