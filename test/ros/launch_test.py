#!/usr/bin/env python3
"""roslaunch can read every launch file. Every `roslaunch` line in the documents and launch files has existing
arguments: roslaunch silently ignores unknown ones. The test starts nothing."""
import glob
import os
import re
import shlex
import sys
import tempfile
import unittest
import xml.etree.ElementTree

import roslaunch.config
import roslaunch.core
import roslaunch.xmlloader

SOURCE = os.path.realpath(sys.argv.pop(1)) if len(sys.argv) > 1 else ""
FILES = sorted(glob.glob(SOURCE + "/launch/*.launch"))
DOCUMENTS = sorted(glob.glob(SOURCE + "/README.md") + glob.glob(SOURCE + "/*/README.md") +
                   glob.glob(SOURCE + "/*/*/README.md"))
REQUIRED = {"replay.launch": ["bag:=/data/a.bag"], "report.launch": ["out:=/tmp/report"], "crtk.launch": ["arms:=PSM1"]}
MORE = {"tissue.launch": [["rviz:=true"], ["rviz:=true", "drag:=true"], ["arm:=PSM1"], ["nodelet:=true"],
                          ["rviz:=true", "arm:=PSM1"],
                          ["tools:=", "labels:=/a.nii", "step:=0.02", "mesh_rate:=1", "volume_rate:=1",
                           "slice_rate:=1"]],
        "dvrk.launch": [["arm:=PSM3", "haptic:=true"]],
        "record.launch": [["bag:=/data/a.bag", "split:=true"], ["cameras:=true"]],
        "scripted.launch": [["rviz:=true"]],
        "replay.launch": [["bag:=/data/a.bag", "sim_time:=false", "loop:=true", "rviz:=true"]]}


# values of arguments for which a text is unsuitable (a switch is inverted), and arguments that they require
VALUES = {"pose": "1 2 3 0 0 0 1", "tool_max_age": "0.125", "arms": "one two three", "arm": "PSM2", "respawn": "true",
          "described": "false"}
VALUES.update({name: "7" for name in ("max_force", "gain", "slip", "step", "mesh_rate", "volume_rate", "slice_rate",
                                      "rate", "start", "min_space", "robot_rate")})
WITH = {"drag": ["rviz:=true"], "rviz_config": ["rviz:=true"], "manager": ["nodelet:=true"],
        "start_manager": ["nodelet:=true"]}
WITH.update({"robot_frame": ["sim_robot:=true"], "robot_rate": ["sim_robot:=true"]})
WITH.update({name: ["haptic:=true"] for name in ("hand", "following", "needs_following", "gain", "max_force", "mtm",
                                                 "teleop")})


def everything(config):
    """Return the actions of roslaunch, as text."""
    nodes = sorted(repr((n.package, n.type, n.name, n.namespace, n.args, sorted(n.remap_args), n.respawn,
                         sorted(n.env_args))) for n in config.nodes)
    return nodes + sorted("%s = %r" % (path, param.value) for path, param in config.params.items())


def load(path, arguments):
    """Load a file as roslaunch does, but without the core's own file, which starts two programs each time."""
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(path, config, argv=arguments, verbose=False)
    return config


def declared(path):
    """Return the default values of the arguments."""
    root = xml.etree.ElementTree.parse(path).getroot()
    return {arg.get("name"): arg.get("default", "") for arg in root.findall("arg") if arg.get("value") is None}


def shown_lines():
    """Return (source, name of the launch file, its arguments) of each line."""
    for path in DOCUMENTS + FILES:
        with open(path, encoding="utf-8") as file:
            for number, line in enumerate(file, 1):
                for rest in re.findall(r"roslaunch pliant ([^`#]*)", line):
                    words = shlex.split(rest)
                    arguments = []
                    for word in words[1:]:
                        if ":=" not in word:
                            break  # a comment
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
                unknown = {argument.split(":=")[0] for argument in arguments} - set(declared(path))
                self.assertFalse(unknown, "of " + name)
                self.assertTrue(load(path, arguments).nodes)

    def test_every_argument_does_something(self):
        for path in FILES:
            name = os.path.basename(path)
            given = {line.split(":=")[0]: line for line in REQUIRED.get(name, [])}
            for argument, default in sorted(declared(path).items()):
                value = ({"true": "false", "false": "true", "$(arg nodelet)": "false"}.get(default)
                         or VALUES.get(argument, "another"))
                context = [line for key, line in given.items() if key != argument] + WITH.get(argument, [])
                with self.subTest(file=name, argument=argument), tempfile.NamedTemporaryFile(
                        "w", suffix=".yaml") as params:
                    params.write("solver: {iterations: 4}\n")
                    params.flush()
                    other = load(path,
                                 context + ["%s:=%s" % (argument, params.name if argument == "params" else value)])
                    before = load(path, context + [line for key, line in given.items() if key == argument])
                    self.assertNotEqual(everything(before), everything(other))

    def test_arguments_arrive(self):
        path = SOURCE + "/launch/"
        node = load(path + "report.launch", ["scan:=a.nii", "scene:=b.yaml", "out:=/c",
                                             "options:=full labels=5,20"]).nodes[0]
        self.assertEqual(node.args.split(), "b.yaml --scan a.nii --out /c --full --labels=5,20".split())
        params = load(path + "tissue.launch", ["tools:=PSM1", "parent_frame:=PSM1_base"]).params
        self.assertEqual(params["/tissue/sim/parent_frame"].value, "PSM1_base")
        self.assertEqual(params["/tissue/sim/tools"].value, "PSM1")

    def test_browsers_get_standard_types_alone(self):
        config = load(SOURCE + "/launch/tissue.launch", ["web:=true", "ns:=liver"])
        nodes = {node.name: node for node in config.nodes}
        self.assertEqual((nodes["rosbridge_websocket"].package, nodes["rosapi"].package),
                         ("rosbridge_server", "rosapi"))
        topics = config.params["/liver/rosbridge_websocket/topics_glob"].value
        for topic in ("slice/*", "mesh/points", "mesh/marker", "*/measured_cf"):
            self.assertIn(topic, topics)
        for topic in topics.strip("[]").split(", "):
            self.assertRegex(topic, "^/(tf|tf_static|diagnostics|liver/.+)$")
            # Pliant's own message types are excluded
            self.assertNotIn(topic, ("/liver/volume", "/liver/*", "/liver/mesh/*"))
        self.assertNotIn("rosbridge_websocket",
                         [node.name for node in load(SOURCE + "/launch/tissue.launch", []).nodes])

    def test_a_fourth_arm_is_refused(self):
        for name in ("crtk.launch", "dvrk.launch", "raven.launch", "ambf.launch"):
            for arms in ("a b c d", "a,b"):
                with self.subTest(file=name, arms=arms):
                    with self.assertRaises(roslaunch.core.RLException) as refused:
                        load(SOURCE + "/launch/" + name, ["arms:=" + arms])
                    self.assertIn('arms:="%s" is refused: name one to three arms' % arms, str(refused.exception))

    def robot(self, name, *arguments):
        config = load(SOURCE + "/launch/" + name, list(arguments))
        nodes = {node.name: node for node in config.nodes}
        return dict(nodes["sim"].remap_args), {path: param.value for path, param in config.params.items()}, nodes

    def test_robots_plug_in_by_their_names(self):
        topics, params, nodes = self.robot("dvrk.launch", "arms:=PSM1 PSM2", "rviz:=true", "blade:=scalpel")
        for arm in ("PSM1", "PSM2"):
            self.assertEqual(topics[arm + "/measured_cp"], "/%s/measured_cp" % arm)
            self.assertEqual(topics[arm + "/jaw/measured_js"], "/%s/jaw/measured_js" % arm)
            self.assertEqual(topics[arm + "/energy"], "/footpedals/coag")
            self.assertEqual(params["/tissue/sim/tool/%s/blade" % arm], "scalpel")
        self.assertEqual(params["/tissue/sim/tools"], "PSM1 PSM2 mouse")
        self.assertEqual(params["/tissue/sim/parent_frame"], "PSM1_base")
        self.assertEqual(params["/tissue/sim/tool_max_age"], 0.25)
        self.assertFalse([path for path in params if "none_" in path])
        self.assertNotIn("force_guard", nodes)
        self.assertEqual(dict(nodes["rviz"].remap_args)["grasper/marker"], "PSM1/marker")
        nodes = self.robot("tissue.launch", "rviz:=true")[2]
        self.assertEqual(dict(nodes["rviz"].remap_args)["grasper/marker"], "grasper/marker")

        self.assertNotIn("/tissue/sim/grasp/kind", params, "the scene's own")
        self.assertEqual(self.robot("dvrk.launch", "grasp:=blob")[1]["/tissue/sim/grasp/kind"], "blob")

        topics, params, nodes = self.robot("dvrk.launch", "arm:=PSM2", "haptic:=true", "gain:=0.1")
        guard = dict(nodes["force_guard"].remap_args)
        self.assertEqual(guard["following"], "/MTML_PSM2/following")
        self.assertEqual(guard["servo_cf"], "/MTML/body/servo_cf")
        self.assertEqual(guard["PSM2/measured_cp"], "/PSM2/measured_cp")
        self.assertEqual(params["/tissue/force_guard/gain"], 0.1)
        self.assertTrue(nodes["force_guard"].respawn, "one that was killed is followed by one that begins with zeros")
        self.assertEqual(params["/tissue/force_guard/tool"], "PSM2")

        topics, params, nodes = self.robot("crtk.launch", "arms:=hand", "prefix:=/lab", "haptic:=true",
                                           "hand:=/left/body", "following:=/teleop/on")
        guard = dict(nodes["force_guard"].remap_args)
        self.assertEqual([guard[name] for name in ("hand/measured_cp", "following", "servo_cf",
                                                   "set_cf_orientation_absolute")],
                         ["/lab/hand/measured_cp", "/teleop/on", "/left/body/servo_cf",
                          "/left/body/set_cf_orientation_absolute"])
        self.assertEqual([topics["hand/" + name] for name in ("operating_state", "tool_type", "energy")],
                         ["/lab/hand/operating_state", "/lab/hand/tool_type", "/footpedals/coag"])
        topics, params, _ = self.robot("raven.launch")
        self.assertEqual(topics["arm1/measured_cp"], "/arm1/measured_cp")
        self.assertEqual([topics["arm%d/jaw/measured_js" % a] for a in (1, 2)],
                         ["/grasp1/measured_js", "/grasp2/measured_js"])
        topics, params, _ = self.robot("ambf.launch", "arms:=psm1 psm2 psm3")
        self.assertEqual(topics["psm3/measured_cp"], "/CRTK/psm3/measured_cp")
        self.assertEqual(topics["psm2/jaw/measured_js"], "/CRTK/psm2/jaw/servo_jp")
        self.assertEqual(params["/tissue/sim/tool/psm3/jaw"], "setpoint")
        self.assertEqual(params["/tissue/sim/parent_frame"], "psm1/baselink")
        topics, params, _ = self.robot("crtk.launch", "arms:=hand", "prefix:=/lab", "arm_frame:=table")
        self.assertEqual(topics["hand/measured_cp"], "/lab/hand/measured_cp")
        self.assertEqual(params["/tissue/sim/tool/hand/frame"], "table")

    def assert_recorded(self, robot, recorder):
        """Check that the recorder's topics include every input of the node and of force_guard."""
        topics, params, nodes = self.robot(*robot, "haptic:=true", "blade:=scalpel", "shape:=tool_type")
        recorded = load(SOURCE + "/launch/record.launch", recorder).nodes[0].args.split(" -e ")[1].strip()
        inputs = ["measured_cp", "jaw/measured_js", "energy", "blade", "tool_type", "operating_state"]
        names = [tool + "/" + name for tool in params["/tissue/sim/tools"].split() for name in inputs]
        found = ([topics.get(name, "/tissue/" + name) for name in names] +
                 [dict(nodes["force_guard"].remap_args)["following"]])
        for topic in found:
            with self.subTest(robot=robot, topic=topic):
                self.assertRegex(topic, "^(?:%s)$" % recorded)
        self.assertNotRegex("/tissue/volume", "^(?:%s)$" % recorded)
        return found

    def test_what_robots_send_is_recorded(self):
        self.assertIn("/footpedals/coag", self.assert_recorded(["dvrk.launch", "arms:=PSM1 PSM2"], []))
        self.assertIn("/grasp2/measured_js", self.assert_recorded(["raven.launch", "following:=/teleop/following"], []))
        self.assertIn("/CRTK/psm1/jaw/servo_jp",
                      self.assert_recorded(["ambf.launch", "following:=/teleop/following"], []))
        others = ["energy:=/pedals/4", "jaws:=/hands/left", "following:=/leads"]
        self.assertIn("/hands/left", self.assert_recorded(["crtk.launch", "arms:=left", "prefix:=/lab"] + others,
                                                          others))


if __name__ == "__main__":
    unittest.main()
