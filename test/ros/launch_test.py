#!/usr/bin/env python3
"""Every launch file can be read by roslaunch, and every `roslaunch` line that README.md and the launch files show names
arguments that there are: roslaunch itself drops an unknown one without a word. Nothing is started."""
import glob
import os
import re
import shlex
import sys
import unittest
import xml.etree.ElementTree

import roslaunch.config
import roslaunch.xmlloader

SOURCE = os.path.realpath(sys.argv.pop(1)) if len(sys.argv) > 1 else ""
FILES = sorted(glob.glob(SOURCE + "/launch/*.launch"))
REQUIRED = {"replay.launch": ["bag:=/data/a.bag"], "report.launch": ["out:=/tmp/report"]}
MORE = {"tissue.launch": [["rviz:=true"], ["arm:=PSM1"], ["nodelet:=true"], ["rviz:=true", "arm:=PSM1"],
                          ["tools:=", "labels:=/a.nii", "step:=0.02", "mesh_rate:=1", "volume_rate:=1", "slice_rate:=1"]],
        "record.launch": [["bag:=/data/a.bag", "split:=true"]],
        "scripted.launch": [["rviz:=true"]],
        "replay.launch": [["bag:=/data/a.bag", "sim_time:=false", "loop:=true", "rviz:=true"]]}


def load(path, arguments):
    """As roslaunch does, but without the core's own file, which starts two programs each time."""
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(path, config, argv=arguments, verbose=False)
    return config


def declared(path):
    root = xml.etree.ElementTree.parse(path).getroot()
    return {arg.get("name") for arg in root.findall("arg") if arg.get("value") is None}


def shown_lines():
    """(where, name of the launch file, its arguments)"""
    for path in [SOURCE + "/README.md"] + FILES:
        with open(path, encoding="utf-8") as file:
            for number, line in enumerate(file, 1):
                for rest in re.findall(r"roslaunch pliant ([^`#]*)", line):
                    words = shlex.split(rest)
                    arguments = []
                    for word in words[1:]:
                        if ":=" not in word:
                            break  # a remark
                        arguments.append(word)
                    yield "%s:%d" % (os.path.basename(path), number), words[0], arguments


class LaunchTest(unittest.TestCase):
    def test_files_load(self):
        self.assertGreater(len(FILES), 4)
        for path in FILES:
            name = os.path.basename(path)
            for arguments in [REQUIRED.get(name, [])] + MORE.get(name, []):
                with self.subTest(file=name, arguments=arguments):
                    self.assertTrue(load(path, arguments).nodes)

    def test_shown_lines_load_with_arguments_that_there_are(self):
        lines = list(shown_lines())
        self.assertGreater(len(lines), 10)
        for where, name, arguments in lines:
            with self.subTest(where=where, file=name, arguments=arguments):
                path = SOURCE + "/launch/" + name
                unknown = {argument.split(":=")[0] for argument in arguments} - declared(path)
                self.assertFalse(unknown, "of " + name)
                self.assertTrue(load(path, arguments).nodes)

    def test_arguments_arrive(self):
        path = SOURCE + "/launch/"
        node = load(path + "report.launch", ["scan:=a.nii", "scene:=b.yaml", "out:=/c", "options:=full labels=5,20"]).nodes[0]
        self.assertEqual(node.args.split(), "b.yaml --scan a.nii --out /c --full --labels=5,20".split())
        params = load(path + "tissue.launch", ["tools:=PSM1", "parent_frame:=PSM1_base"]).params
        self.assertEqual(params["/tissue/sim/parent_frame"].value, "PSM1_base")
        self.assertEqual(params["/tissue/sim/tools"].value, "PSM1")


if __name__ == "__main__":
    unittest.main()
