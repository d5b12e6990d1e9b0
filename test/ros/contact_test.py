#!/usr/bin/env python3
"""Test instruments with a shape through the topics of a robot: the published contact forces equal the measured
force, and jaws hold the tissue between them."""
import os
import shutil
import sys
import threading
import time
import unittest

import numpy
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, WrenchStamped
from pliant.msg import ContactState, Step, StepTiming
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from node_client import NAMESPACE, Latest, Launch, Node, wait_for  # noqa: E402

VOXELS, SPACING = (10, 4, 12), (3.0, 1.5, 2.0)  # a tongue of 30 x 6 x 24 mm on a plate
TOP = numpy.array([0.0151, 0.0031, 0.024])
MATERIALS = "materials: [{name: liver, young_modulus: 5000, poisson_ratio: 0.4, density: 1000, range: [0, 1000]}]\n"
SCENE = """material: {file: materials.yaml}
mesh: {coarse_cells: [10, 3, 8], ratio: 1}
model: {method: fine}
solver: {threads: 1, iterations: 30}
contact: {friction: 0.5}
fixed: {planes: [{point: [0, 0, 1.0e-4], normal: [0, 0, 1]}]}
"""
PARAMS = "{tool_max_age: 10, jaw_close: 0.25, jaw_release: 0.5, output: {mesh_rate: 100}}\n"
OPEN, CLOSED = 0.7, 0.2  # [rad]: on the tissue, and below jaw_close


def write_tongue(path):
    """Write a tongue of one tissue as a MetaImage."""
    with open(path, "wb") as file:
        file.write(("ObjectType = Image\nNDims = 3\nDimSize = %d %d %d\nElementSpacing = %g %g %g\nOffset = %g %g %g\n"
                    "BinaryData = True\n"
                    "BinaryDataByteOrderMSB = False\nElementType = MET_SHORT\nElementDataFile = LOCAL\n" %
                    (VOXELS + SPACING + tuple(0.5 * each for each in SPACING))).encode())
        file.write(numpy.full(VOXELS[::-1], 100, "<i2").tobytes())


class Arm:
    """Publishes its pose, upside down, and its jaw at 100 Hz, after the first call of go()."""

    def __init__(self, name, number, instrument, steps):
        self.number, self.steps, self.place, self.angle = number, steps, None, OPEN
        self.pose = rospy.Publisher("/%s/measured_cp" % name, PoseStamped, queue_size=1)
        self.jaw = rospy.Publisher("/%s/jaw/measured_js" % name, JointState, queue_size=1)
        self.type = rospy.Publisher("/%s/tool_type" % name, String, queue_size=1, latch=True)
        self.type.publish(instrument)
        wait_for(lambda: steps.message and steps.message.tools[number].shape, "the shape of " + instrument)
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while not rospy.is_shutdown():
            if self.place is not None:
                pose, jaw = PoseStamped(), JointState(position=[self.angle])
                pose.header.stamp = jaw.header.stamp = rospy.Time.now()
                pose.header.frame_id = "tissue"
                pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = self.place
                pose.pose.orientation.x = 1.0
                self.pose.publish(pose)
                self.jaw.publish(jaw)
            time.sleep(0.01)

    def go(self, place, angle=OPEN):
        """Move there, and wait until a step has used this pose."""
        self.place, self.angle = [float(each) for each in place], angle

        def there():
            tool = self.steps.message.tools[self.number]
            return tool.present and tool.jaw == angle and list(tool.tip) == self.place
        wait_for(there, "a step with the arm at %s" % self.place, pause=0.002)

    def way(self, begin, end, steps, angles=(OPEN, OPEN)):
        for share in numpy.linspace(0, 1, steps + 1)[1:]:
            self.go((1 - share) * numpy.asarray(begin) + share * numpy.asarray(end), (1 - share) * angles[0] + share *
                    angles[1])


class Pairs:
    """A tool's contacts together with its force and torque of the same step: [(ContactState, (6) [N, N m])]."""

    def __init__(self, tool):
        self.wrenches, self.all = {}, []
        self.subscribers = [rospy.Subscriber(NAMESPACE + tool + "/contact", ContactState, self.all.append,
                                             queue_size=100),
                            rospy.Subscriber(NAMESPACE + tool + "/measured_cf", WrenchStamped, self.take,
                                             queue_size=100)]

    def take(self, message):
        force, torque = message.wrench.force, message.wrench.torque
        self.wrenches[message.header.stamp] = numpy.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])

    def told(self):
        return [(contact, self.wrenches[contact.header.stamp]) for contact in list(self.all)
                if contact.header.stamp in self.wrenches]

    def close(self):
        for subscriber in self.subscribers:
            subscriber.unregister()


def row(vector):
    return numpy.array([vector.x, vector.y, vector.z])


def rows(vectors):
    return numpy.array([(each.x, each.y, each.z) for each in vectors]).reshape(-1, 3)


def pressed(contact, tip):
    """Return the force, and the torque about the tip, of all contact points."""
    force = rows(contact.forces)
    return numpy.concatenate([force.sum(axis=0), numpy.cross(rows(contact.points) - tip, force).sum(axis=0)])


class ContactTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("contact_test")
        folder = rospy.get_param("~folder")
        shutil.rmtree(folder, ignore_errors=True)
        os.makedirs(folder)
        write_tongue(folder + "/tongue.mha")
        for name, text in (("materials.yaml", MATERIALS), ("scene.yaml", SCENE), ("params.yaml", PARAMS)):
            with open(folder + "/" + name, "w") as file:
                file.write(text)
        cls.live = Launch("crtk.launch", arms="PSM1 PSM2", scan=folder + "/tongue.mha", scan_root=folder,
                          scene=folder + "/scene.yaml",
                          params=folder + "/params.yaml", shape="tool_type", grasp="auto", slip="0")
        try:
            cls.node, cls.steps = Node("PSM1"), Latest("step", Step)
            cls.node.wait_until_running()
            cls.forceps = Arm("PSM1", 0, "PROGRASP_FORCEPS:420093", cls.steps)
            cls.probe = Arm("PSM2", 1, "probe", cls.steps)
            cls.diagnostics = Latest("/diagnostics", DiagnosticArray)
        except BaseException:
            cls.live.stop()
            raise

    @classmethod
    def tearDownClass(cls):
        cls.live.stop()

    def lifted(self):
        """Return the current maximum upward displacement of a node [m]."""
        def matching():
            state = self.node.mesh.fresh()
            return state if state.revision == self.node.topology.message.revision else None
        nodes = numpy.array(wait_for(matching, "a mesh state of this revision").nodes).reshape(-1, 3)
        return float((nodes - self.node.rest())[:, 2].max())

    def close_on_the_tongue(self):
        """Close the jaws with their tips 12 mm below the top."""
        below = TOP - [0, 0, 0.012]
        self.forceps.way(TOP + [0, 0, 0.03], below, 6)
        self.forceps.way(below, below, 12, (OPEN, CLOSED))
        return below

    def leave(self, place, angle):
        self.forceps.way(place, place, 3, (angle, OPEN))
        self.forceps.way(place, TOP + [0, 0, 0.08], 8)
        wait_for(lambda: self.node.displacement() < 1e-4, "the tissue to be where it was")

    def test_what_presses_tells_the_force_that_is_felt(self):
        tip = TOP - [0, 0, 0.002]
        pairs = Pairs("PSM2")
        self.addCleanup(pairs.close)
        self.probe.way(TOP + [0, 0, 0.01], tip, 6)

        def agrees(contact, wrench):
            told = pressed(contact, row(contact.proxy.position))
            return (numpy.allclose(told[:3], wrench[:3], rtol=1e-9, atol=1e-12)
                    and numpy.allclose(told[3:], wrench[3:], rtol=1e-9, atol=1e-14))

        def risen():
            """Return five consecutive pairs with contact and equal forces: the filtered force rises over 0.2 s."""
            last = pairs.told()[-5:]
            return (len(last) == 5 and all(contact.points and agrees(contact, wrench) for contact, wrench in last)
                    and last)
        for contact, wrench in wait_for(risen, "contacts whose forces are those that are felt"):
            self.assertTrue(contact.present and not contact.grasped)
            self.assertEqual({len(contact.normals), len(contact.forces), len(contact.areas)}, {len(contact.points)})
            numpy.testing.assert_allclose(numpy.linalg.norm(rows(contact.normals), axis=1), 1, atol=1e-12)
            self.assertLess(rows(contact.normals)[:, 2].max(), 0)  # into the tissue
            self.assertTrue(all(area >= 0 for area in contact.areas))
            # less than the top of the tongue
            self.assertTrue(0 < sum(contact.areas) < VOXELS[0] * SPACING[0] * VOXELS[1] * SPACING[1] * 1e-6)
            self.assertLess(wrench[2], -0.01)
        self.probe.way(tip, TOP + [0, 0, 0.08], 8)
        wait_for(lambda: not pairs.told()[-1][0].points and (pairs.told()[-1][1] == 0).all(), "no force in air")

    def diagnosed(self, name):
        """Return the last (status, values) of the diagnostics with this name."""
        found = ([each for each in self.diagnostics.message.status if each.name.endswith(": " + name)]
                 if self.diagnostics.message else [])
        return found and (found[0], {each.key: each.value for each in found[0].values})

    def load(self, *options):
        answer = self.node.load("tongue.mha", options=list(options))
        self.assertTrue(answer.success, answer.message)

    def press(self, deep, **limits):
        """Load the scan with these limits of group contact, press the top of the tongue with the probe, and stay
        there. Return the probe's contact at rest."""
        self.load(*("contact/%s=%g" % each for each in limits.items()))
        self.addCleanup(lambda: self.load(*("contact/%s=%g" % (name, {"max_force": 20, "coupling_stiffness": 1e6}[name])
                                            for name in limits)))
        self.addCleanup(lambda: self.probe.way(TOP - [0, 0, deep], TOP + [0, 0, 0.08], 8))
        self.probe.way(TOP + [0, 0, 0.01], TOP - [0, 0, deep], 10)
        contacts = Latest("PSM2/contact", ContactState)
        self.addCleanup(contacts.close)
        return self.at_rest(contacts)

    def at_rest(self, contacts):
        """Return a contact whose proxy has not moved for 0.3 s."""
        def rests():
            before = contacts.fresh()
            now = contacts.since(before.header.stamp + rospy.Duration(0.3))
            return (numpy.allclose(row(now.proxy_error), row(before.proxy_error), rtol=0, atol=1e-6)
                    and abs(now.jaw_error - before.jaw_error) < 1e-4 and now)
        return wait_for(rests, "a proxy at rest")

    def test_a_force_limit_is_published_while_it_lasts(self):
        deep, limit = 0.004, 0.01  # [m], [N]: without the limit the probe presses with more than 0.05 N
        timing, markers = Latest("timing", StepTiming), Latest("PSM2/marker", MarkerArray)
        self.addCleanup(timing.close)
        self.addCleanup(markers.close)
        contact = self.press(deep, max_force=limit)
        self.assertTrue(contact.saturated)
        error, tip = row(contact.proxy_error), TOP - [0, 0, deep]
        print("proxy error %s mm, angle %.3f rad" % (1e3 * error, contact.proxy_angle))
        self.assertLess(error[2], -0.001)
        numpy.testing.assert_allclose(row(contact.proxy.position), tip - error, rtol=0, atol=1e-12)
        q = contact.proxy.orientation
        # the tool is rotated about x by half a turn
        self.assertAlmostEqual(contact.proxy_angle, 2 * numpy.arccos(min(1, abs(q.x))), delta=1e-3)
        self.assertAlmostEqual(contact.jaw_error, 0, delta=1e-6)  # a probe has no jaws
        self.assertLess(numpy.linalg.norm(pressed(contact, tip)[:3]), 1.05 * limit)
        self.assertGreater(numpy.linalg.norm(pressed(contact, tip)[:3]), 0.9 * limit)
        told = timing.fresh()
        self.assertEqual(told.ended, StepTiming.FORCE_LIMIT)
        self.assertAlmostEqual(told.max_proxy_error, numpy.linalg.norm(error), delta=1e-4)
        self.assertTrue(0 <= told.advanced <= 1 and told.legs >= 1 and told.evaluations >= 1)
        self.assertGreaterEqual(self.steps.fresh().legs, 1)
        shown = {}
        markers.message = None  # MarkerArray has no stamp: wait for the next message
        for marker in wait_for(lambda: markers.message, "markers").markers:
            shown.setdefault(marker.ns, []).append(marker)
        solid, ghost = shown["PSM2/proxy"], shown["PSM2/measured"]
        self.assertEqual({each.color.a for each in solid + ghost}, {0.25, 1})
        self.assertTrue(all(each.color.a == 1 for each in solid)
                        and all(each.action == Marker.ADD for each in solid + ghost))
        apart = row(ghost[-1].pose.position) - row(solid[-1].pose.position)
        numpy.testing.assert_allclose(apart, error, rtol=0, atol=1e-3)

        def warns():  # once per second; the first one may belong to an earlier step
            found = self.diagnosed("tool PSM2")
            return (found and "force limit" in found[0].message
                    and abs(float(found[1]["proxy error [mm]"]) - 1e3 * numpy.linalg.norm(error)) < 0.1 and found)
        status, values = wait_for(warns, "a warning of the force limit with the error that the contact has")
        self.assertEqual((status.level, values["force limit reached"]), (DiagnosticStatus.WARN, "True"))
        solver = wait_for(lambda: self.diagnosed("solver")
                          and int(self.diagnosed("solver")[1]["steps in the last second that ended early"]) > 0 and
                          self.diagnosed("solver")[1], "steps that ended early")
        self.assertIn("contact/max_force", solver["reason of the last step that ended early"])
        self.assertGreaterEqual(int(solver["legs"]), 1)
        self.assertGreater(float(solver["largest proxy error [mm]"]), 1)
        self.probe.way(tip, TOP + [0, 0, 0.08], 8)
        wait_for(lambda: self.diagnosed("tool PSM2")[0].level == DiagnosticStatus.OK, "the end of the warning")
        contact = self.node_contact("PSM2")
        self.assertFalse(contact.saturated)
        self.assertLess(numpy.linalg.norm(row(contact.proxy_error)), 1e-6)

    def node_contact(self, tool):
        contacts = Latest(tool + "/contact", ContactState)
        try:
            return contacts.fresh()
        finally:
            contacts.close()

    def test_a_proxy_that_stays_behind_at_rest_is_a_warning(self):
        contact = self.press(0.006, coupling_stiffness=1)  # soft: tissue stops the proxy at a force far below the limit
        self.assertFalse(contact.saturated)
        self.assertLess(contact.proxy_error.z, -0.002)

        def warns():
            found = self.diagnosed("tool PSM2")
            return found and "mm behind" in found[0].message and found
        status, values = wait_for(warns, "a warning of a proxy that is behind")
        self.assertIn("while the tool rests", status.message)
        self.assertEqual((status.level, values["force limit reached"]), (DiagnosticStatus.WARN, "False"))

    def test_jaws_that_close_hold_by_friction_what_comes_along(self):
        place = self.close_on_the_tongue()
        contact = wait_for(lambda: self.node.contact.fresh(), "the jaws' contacts")
        sideways = rows(contact.normals)[:, 1]
        self.assertTrue(sideways.min() < -0.5 and sideways.max() > 0.5, "jaws press from both sides: %s" % sideways)
        self.assertEqual((contact.grasped, contact.held_nodes), (False, 0))
        before = self.lifted()
        up = place + [0, 0, 0.003]  # they hold up to 4 mm, and release before 12 mm
        pairs = Pairs("PSM1")
        self.addCleanup(pairs.close)
        self.forceps.way(place, up, 6, (CLOSED, CLOSED))
        wait_for(lambda: pairs.told() and pairs.told()[-1][1][2] > 0.01, "a pull that is felt")
        contact = self.node.contact.fresh()
        self.assertEqual((contact.grasped, contact.held_nodes), (False, 0))
        self.assertGreater(pressed(contact, up)[2], 0.01)
        lifted = self.lifted()
        print("lifted by %.2f mm, %.2f before, with %.3f N at %d points" %
              (1e3 * lifted, 1e3 * before, pressed(contact, up)[2], len(contact.points)))
        self.assertGreater(lifted, before + 0.0015)
        away = place + [0, 0, 0.02]
        self.forceps.way(up, away, 34, (CLOSED, CLOSED))
        wait_for(lambda: not self.node.contact.fresh().points and self.lifted() < 1e-4, "the tissue to slip out")
        self.leave(away, CLOSED)

    def test_jaws_stop_at_their_torque(self):
        self.load("contact/grip_torque=1e-4")
        self.addCleanup(lambda: self.load("contact/grip_torque=0.1"))
        place = self.close_on_the_tongue()
        contact = self.at_rest(self.node.contact)
        print("jaw error %.3f rad" % contact.jaw_error)
        self.assertTrue(contact.saturated)
        self.assertLess(contact.jaw_error, -0.02)  # the proxy's jaws are more open

        def warns():
            found = self.diagnosed("tool PSM1")
            return (found and "force limit" in found[0].message
                    and abs(float(found[1]["jaw error [rad]"]) - contact.jaw_error) < 0.02)
        wait_for(warns, "a warning of the force limit with the error that the contact has")
        self.leave(place, CLOSED)

    def test_the_same_jaws_take_a_blob_where_the_scene_says_so(self):
        self.assertTrue(self.node.load("tongue.mha", options=["grasp/kind=blob"]).success)
        self.addCleanup(lambda: self.node.load("tongue.mha", options=["grasp/kind=auto"]))
        self.close_on_the_tongue()
        contact = wait_for(lambda: self.node.contact.fresh().grasped and self.node.contact.message, "a hold")
        self.assertGreater(contact.held_nodes, 3)
        self.leave(TOP - [0, 0, 0.012], CLOSED)
        self.assertFalse(self.node.contact.fresh().grasped)


if __name__ == "__main__":
    rostest.rosrun("pliant", "contact", ContactTest)
