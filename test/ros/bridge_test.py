#!/usr/bin/env python3
"""Test the statements of launch/README.md on ROS 2: the bridge's list matches the node, and package pliant_msgs matches
ROS 1's package pliant.

ros1_bridge maps messages with the same field names, and services with the same field names, types and order. The
parsers of ROS 1 (genmsg) and ROS 2 (rosidl, Debian package python3-rosidl) read both packages, and the test compares
the fields."""
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time
import unittest
import xml.etree.ElementTree

import genmsg
import genmsg.msg_loader
import rosgraph
import roslib.message
import rospy
import rosservice
import rostest
import yaml
from pliant.msg import SimState

try:
    import rosidl_adapter.parser
    import rosidl_parser.definition as idl
    import rosidl_parser.parser
except ImportError:
    idl = None

SOURCE = pathlib.Path(os.path.realpath(__file__)).parent.parent.parent
ROS2_TYPES = {"bool": "boolean", "float32": "float", "float64": "double", "string": "string"}
ROS2_TYPES.update((sign + "int" + bits, sign + "int" + bits) for sign in ("", "u") for bits in ("8", "16", "32", "64"))
CONVERT = """
import pathlib, sys
from rosidl_adapter.msg import convert_msg_to_idl
package = pathlib.Path(sys.argv[1])
for name in sys.argv[2:]:
    convert_msg_to_idl(package, package.name, pathlib.Path("msg/%s.msg" % name), package / "msg")
"""


def ros1_name(ros2_type):
    """Convert pliant_msgs/msg/SimState to pliant/SimState."""
    package, _, kind = ros2_type.split("/")
    return "%s/%s" % ("pliant" if package == "pliant_msgs" else package, kind)


def ros2_type_of(ros1_field):
    """Return the ROS 2 type of a ROS 1 field, and None, the size of an array, or "sequence"."""
    base, _, array = ros1_field.type.partition("[")
    package, _, kind = base.rpartition("/")
    name = ROS2_TYPES.get(base) or "%s/%s" % ({"pliant": "pliant_msgs", "": "pliant_msgs"}.get(package, package), kind)
    return name, None if not array else int(array[:-1]) if array != "]" else "sequence"


def idl_type_of(of):
    if isinstance(of, idl.AbstractNestedType):
        return idl_type_of(of.value_type)[0], of.size if isinstance(of, idl.Array) else "sequence"
    if isinstance(of, idl.NamespacedType):
        return "%s/%s" % (of.namespaces[0], of.name), None
    return of.typename if isinstance(of, idl.BasicType) else "string", None


class BridgeList(unittest.TestCase):
    def test_topics_and_services_are_those_of_the_node(self):
        rospy.init_node("bridge_test")
        self.assertGreaterEqual(rospy.wait_for_message("/tissue/state", SimState, 60).state, SimState.LOADING)
        rospy.wait_for_service("/tissue/reset", 60)
        rospy.wait_for_message("/tissue/timing", rospy.AnyMsg, 60)
        listed = yaml.safe_load((SOURCE / "launch/ros2_bridge.yaml").read_text())
        # the node subscribes to any type; the master has a type once there is a publisher
        publishers = [rospy.Publisher(topic["topic"], roslib.message.get_message_class(ros1_name(topic["type"])),
                                      queue_size=1)
                      for topic in listed["topics"] if topic["topic"].endswith(("/measured_cp", "/measured_js"))]
        self.assertEqual(len(publishers), 2)
        end = time.time() + 20
        while min(publisher.get_num_connections() for publisher in publishers) == 0:
            self.assertLess(time.time(), end, "the node subscribes to poses and jaws")
            time.sleep(0.05)
        types = dict(rosgraph.Master("/bridge_test").getTopicTypes())
        self.assertEqual({topic["topic"]: types.get(topic["topic"]) for topic in listed["topics"]},
                         {topic["topic"]: ros1_name(topic["type"]) for topic in listed["topics"]})
        self.assertEqual({service["service"]: rosservice.get_service_type(service["service"])
                          for service in listed["services_1_to_2"]},
                         {service["service"]: ros1_name(service["type"]) for service in listed["services_1_to_2"]})
        for kind, entries in (("msg", listed["topics"]), ("srv", listed["services_1_to_2"])):
            self.assertEqual({entry["type"].split("/")[1] for entry in entries}, {kind})


class Ros2Package(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.room = tempfile.TemporaryDirectory()
        done = subprocess.run([str(SOURCE / "launch/ros2_messages"), cls.room.name], check=True, stdout=subprocess.PIPE,
                              universal_newlines=True)
        cls.printed = done.stdout
        cls.package = pathlib.Path(cls.room.name) / "pliant_msgs"

    @classmethod
    def tearDownClass(cls):
        cls.room.cleanup()

    def names(self, kind):
        return [sorted(path.stem for path in (package / kind).glob("*." + kind)) for package in (SOURCE, self.package)]

    def test_the_rule_maps_the_package(self):
        manifest = xml.etree.ElementTree.parse(self.package / "package.xml").getroot()
        self.assertEqual(manifest.findtext("name"), "pliant_msgs")
        self.assertEqual(manifest.findtext("version"),
                         xml.etree.ElementTree.parse(SOURCE / "package.xml").getroot().findtext("version"))
        self.assertEqual(manifest.findtext("member_of_group"), "rosidl_interface_packages")
        rules = manifest.find("export/ros1_bridge").get("mapping_rules")
        self.assertIn("FILES %s DESTINATION" % rules, (self.package / "CMakeLists.txt").read_text())
        # with only two keys, ros1_bridge pairs all messages and services by name
        self.assertEqual(yaml.safe_load((self.package / rules).read_text()),
                         [{"ros1_package_name": "pliant", "ros2_package_name": "pliant_msgs"}])
        text = "".join(path.read_text() for path in self.package.glob("*/*.[ms]*"))
        used = set(re.findall(r"^(\w+)/\w+[\[\] ]", text, re.MULTILINE))
        self.assertEqual(used, {entry.text for entry in manifest.findall("depend")})

    @unittest.skipIf(idl is None, "python3-rosidl is missing")
    def test_every_message_has_the_fields_and_constants_of_ros_1(self):
        ros1, ros2 = self.names("msg")
        self.assertEqual(ros1, ros2)
        # in a separate process, because the converter replaces sys.stdout
        subprocess.run([sys.executable, "-c", CONVERT, str(self.package)] + ros1, check=True, stdout=subprocess.DEVNULL)
        for name in ros1:
            path, context = str(SOURCE / "msg" / (name + ".msg")), genmsg.MsgContext.create_default()
            spec = genmsg.msg_loader.load_msg_from_file(context, path, "pliant/" + name)
            tree = rosidl_parser.parser.parse_idl_file(idl.IdlLocator(self.package.parent,
                                                                      pathlib.Path("pliant_msgs/msg/%s.idl" % name)))
            message, = tree.content.get_elements_of_type(idl.Message)
            self.assertEqual([(member.name,) + idl_type_of(member.type) for member in message.structure.members],
                             [(field.name,) + ros2_type_of(field) for field in spec.parsed_fields()], name)
            self.assertEqual([(constant.name, constant.value) for constant in message.constants],
                             [(constant.name, constant.val) for constant in spec.constants], name)

    @unittest.skipIf(idl is None, "python3-rosidl is missing")
    def test_every_service_but_those_with_arrays_of_fixed_size(self):
        ros1, ros2 = self.names("srv")
        left_out = []
        for name in ros1:
            path, context = str(SOURCE / "srv" / (name + ".srv")), genmsg.MsgContext.create_default()
            spec = genmsg.msg_loader.load_srv_from_file(context, path, "pliant/" + name)
            fields = [part.fields() for part in (spec.request, spec.response)]
            if any(re.search(r"\[\d", kind) for part in fields for kind, _ in part):
                left_out.append(name)
                continue
            read = rosidl_adapter.parser.parse_service_file("pliant_msgs", str(self.package / "srv" / (name + ".srv")))
            self.assertEqual([[(str(field.type), field.name) for field in part.fields]
                              for part in (read.request, read.response)],
                             fields, name)
        self.assertEqual(sorted(ros2 + left_out), ros1)
        self.assertEqual(re.findall(r"^(\w+) is left out", self.printed, re.MULTILINE), left_out)


if __name__ == "__main__":
    class Everything(BridgeList, Ros2Package):
        """rostest runs one class."""

    rostest.rosrun("pliant", "bridge", Everything)
