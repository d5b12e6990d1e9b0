#!/usr/bin/env python3
"""Test a blade over topics and the cutting services: two pieces, the order of topologies and states, undo, reset,
and the recorded session."""
import contextlib
import csv
import os
import shutil
import subprocess
import sys
import time
import unittest

import numpy
import rosbag
import rospy
import rostest
from geometry_msgs.msg import Point, Vector3, WrenchStamped
from pliant.msg import ContactState, Cut, MeshState, MeshTopology, Step
from pliant.srv import CutLine, LoadScan, SaveVolume
from sensor_msgs.msg import Image, Joy, PointCloud2
from std_msgs.msg import Bool, Header
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from node_client import NAMESPACE, Latest, Launch, Tool, call, is_sent, nifti_voxels, wait_for  # noqa: E402

SECONDS = 60.0  # time limit on a busy machine
ORIGIN = numpy.array([0.5, 0.25, 1.0])  # pose of the tissue in world, as in cut.test


def to_world(point):
    return [ORIGIN[0] - point[1], ORIGIN[1] + point[0], ORIGIN[2] + point[2]]


def large_pieces(topology):
    """Return the sizes of the connected pieces with at least a hundredth of all tetrahedra."""
    tets = numpy.array(topology.tetrahedra).reshape(-1, 4)
    piece = numpy.arange(len(topology.rest_parent))
    while True:
        least = piece[tets].min(axis=1)
        smaller = piece.copy()
        numpy.minimum.at(smaller, tets.ravel(), numpy.repeat(least, 4))
        smaller = smaller[smaller]
        if (smaller == piece).all():
            break
        piece = smaller
    _, counts = numpy.unique(piece[tets[:, 0]], return_counts=True)
    return sorted(int(count) for count in counts if count > 0.01 * len(tets))


class CutTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("cut_test")
        cls.folder = rospy.get_param("~folder")
        shutil.rmtree(cls.folder, ignore_errors=True)
        os.makedirs(cls.folder)
        cls.topologies, cls.states = [], []
        cls.node_topology = rospy.Subscriber(NAMESPACE + "mesh/topology", MeshTopology, cls.topologies.append,
                                             buff_size=1 << 26)
        cls.node_state = rospy.Subscriber(NAMESPACE + "mesh/state", MeshState, cls.states.append, buff_size=1 << 26)
        cls.state, cls.cut, cls.by_service = Latest("step", Step), Latest("knife/cut", Cut), Latest("cut", Cut)
        cls.blade = rospy.Publisher(NAMESPACE + "knife/blade", Bool, queue_size=1, latch=True)
        cls.energy = rospy.Publisher(NAMESPACE + "knife/energy", Joy, queue_size=1, latch=True)
        cls.tool = Tool("knife", "tissue")
        cls.first = wait_for(lambda: cls.topologies[0] if cls.topologies else None, "mesh/topology", SECONDS)
        rest = numpy.array(cls.first.rest_nodes).reshape(-1, 3)
        cls.low, cls.high = rest.min(axis=0), rest.max(axis=0)
        cls.height = float(0.5 * (cls.low[2] + cls.high[2]) + 0.004)
        wait_for(lambda: cls.state.message, "steps", SECONDS)

    def setUp(self):
        self.blade.publish(False)
        self.tool.reset()
        self.assertTrue(call("reset", Trigger).success)
        self.wait_for_revision(self.first.revision)

    def revision(self):
        return self.state.fresh().revision

    def wait_for_revision(self, revision):
        """Wait for this revision. Return its topology, which must be the last one."""
        wait_for(lambda: self.revision() == revision, "revision %d" % revision)
        return wait_for(lambda: self.topologies[-1] if self.topologies[-1].revision == revision else None,
                        "its topology")

    def appear(self, position):
        self.tool.position, self.tool.is_on = list(position), True
        wait_for(lambda: self.tool.pose.get_num_connections() and self.blade.get_num_connections(),
                 "the node to listen")
        wait_for(lambda: self.state.fresh().tools[0].present, "the knife to be there")

    def stroke(self, until=1.02):
        """Cut from the right to the left by 6 mm per step, up to this fraction of the width."""
        margin = 0.01
        self.appear([self.low[0] - margin, 0, self.height])
        self.blade.publish(True)
        wait_for(lambda: self.state.fresh().tools[0].cuts, "the blade to be on")
        self.sweep(until, margin)
        wait_for(lambda: list(self.state.fresh().tools[0].tip) == self.tool.position, "a step with the last position")
        self.blade.publish(False)
        wait_for(lambda: not self.state.fresh().tools[0].cuts, "the blade to be off")
        return self.wait_for_revision(self.revision())

    def sweep(self, until, margin=0.0):
        """Move on to the left, up to this fraction of the width and a margin."""
        end = self.low[0] + until * (self.high[0] - self.low[0]) + margin
        while self.tool.position[0] < end:
            self.tool.position = [self.tool.position[0] + 0.006, 0, self.height]
            self.state.fresh()  # so that a delayed step sees no jump
        self.tool.position = [end, 0, self.height]

    @contextlib.contextmanager
    def felt(self):
        """Collect the published force of the knife meanwhile: rows of x, y, z [N]."""
        forces = []
        subscriber = rospy.Subscriber(NAMESPACE + "knife/measured_cf", WrenchStamped,
                                      lambda message: forces.append([message.wrench.force.x, message.wrench.force.y,
                                                                     message.wrench.force.z]))
        wait_for(lambda: forces, "knife/measured_cf")
        try:
            yield forces
        finally:
            subscriber.unregister()

    def test_a_blade_feels_what_it_cuts(self):
        with self.loaded("cut/resistance=1", "mesh/coarse_cells=6 5 5"), self.felt() as forces:
            self.appear([self.low[0] - 0.05, 0, self.height])
            self.blade.publish(True)
            wait_for(lambda: self.state.fresh().tools[0].cuts, "the blade to be on")
            self.sweep(0, -0.03)
            self.state.fresh()
            self.assertEqual(numpy.abs(forces).max(), 0, "in air")
            uncut = self.cut.message.severed_area
            self.sweep(0.2)
            wait_for(lambda: self.cut.message.severed_area > uncut, "tissue to part")
            wait_for(lambda: max(force[0] for force in forces) > 50, "a force to the left, as the blade goes")
            x, y, z = numpy.array(forces).T
            self.assertGreater(x.min(), -0.1 * x.max())
            self.assertLess(max(numpy.abs(y).max(), numpy.abs(z).max()), 0.3 * x.max())
            self.blade.publish(False)
            wait_for(lambda: not self.state.fresh().tools[0].cuts, "the blade to be off")
            wait_for(lambda: forces[-1] == [0, 0, 0], "no force")

    def test_a_stroke_makes_two_pieces(self):
        self.assertEqual(len(large_pieces(self.first)), 1)
        with self.felt() as forces:
            self.make_two_pieces()
        self.assertEqual(numpy.abs(forces).max(), 0, "tissue without resistance")

    def make_two_pieces(self):
        begin, told = len(self.states), self.cut.message.stroke if self.cut.message else 0
        topology = self.stroke()
        pieces = large_pieces(topology)
        self.assertEqual(len(pieces), 2, pieces)
        self.assertGreater(min(pieces), 0.3 * sum(pieces))
        self.assertGreater(len(topology.rest_parent), len(self.first.rest_parent))
        self.assertEqual(self.first.first_cut, len(self.first.triangles) // 3)
        self.assertGreater(len(topology.triangles) // 3, topology.first_cut, "faces of the cut")
        self.assertLess(max(topology.triangles), len(topology.rest_parent) + len(topology.vertex_tetrahedron))
        cut = wait_for(lambda: self.cut.message if self.cut.message.revision == topology.revision
                       and not self.cut.message.cutting else None, "knife/cut")
        self.assertEqual(cut.stroke, told + 1)
        width, depth = self.high[0] - self.low[0], self.high[1] - self.low[1]
        self.assertGreater(cut.severed_area, 0.4 * width * depth)
        self.assertLess(cut.severed_area, 1.1 * width * depth)
        # every state was received after its topology
        known = {message.revision: message for message in self.topologies}
        for message in self.states[begin:]:
            self.assertIn(message.revision, known)
            self.assertEqual(len(message.nodes), len(known[message.revision].rest_nodes))
            self.assertLessEqual(known[message.revision].header.stamp, message.header.stamp)
        self.assertGreater(len(set(message.revision for message in self.states[begin:])), 2,
                           "the topology changes while states stream")

    def test_undo_and_reset(self):
        half = self.stroke(0.5)
        self.assertGreater(half.revision, self.first.revision)
        self.assertEqual(len(large_pieces(half)), 1)
        self.assertTrue(call("undo_cut", Trigger).success)
        before = self.wait_for_revision(self.first.revision)
        self.assertEqual(before.tetrahedra, self.first.tetrahedra)
        refused = call("undo_cut", Trigger)
        self.assertFalse(refused.success)
        self.assertIn("no cut to undo", refused.message)
        again = self.stroke(0.5)
        self.assertGreater(again.revision, half.revision, "no two bodies have one number")
        self.assertTrue(call("reset", Trigger).success)
        self.wait_for_revision(self.first.revision)
        wait_for(lambda: self.by_service.message.revision == self.first.revision, "the revision in cut")

    def cut_line(self, frame="world"):
        ends = [[self.low[0] - 0.02, self.low[1] - 0.02, self.height],
                [self.high[0] + 0.02, self.low[1] - 0.02, self.height]]
        depth = self.high[1] - self.low[1] + 0.04
        if frame == "world":
            return call("cut", CutLine, Header(frame_id=frame), [Point(*to_world(end)) for end in ends],
                        Vector3(-depth, 0, 0))
        return call("cut", CutLine, Header(frame_id=frame), [Point(*end) for end in ends], Vector3(0, depth, 0))

    def test_the_service_cuts_in_any_frame(self):
        areas = []
        for frame in ("world", "tissue"):
            answer = self.cut_line(frame)
            self.assertTrue(answer.success, answer.message)
            topology = self.wait_for_revision(answer.revision)
            self.assertEqual(len(large_pieces(topology)), 2)
            areas.append(answer.severed_area)
            self.assertTrue(call("undo_cut", Trigger).success)
            self.wait_for_revision(self.first.revision)
        self.assertAlmostEqual(areas[0], areas[1], delta=1e-3 * areas[1])
        line = [Point(*self.low), Point(*self.high)]
        for depth in (Vector3(), Vector3(*(self.high - self.low))):
            answer = call("cut", CutLine, Header(frame_id="tissue"), line, depth)
            self.assertFalse(answer.success)
            self.assertIn("no area", answer.message)
        for frame, points in (("nowhere", [Point(), Point(x=1)]), ("tissue", [Point()]),
                              ("tissue", [Point(x=float("nan")), Point()])):
            answer = call("cut", CutLine, Header(frame_id=frame), points, Vector3(z=1))
            self.assertFalse(answer.success)
            self.assertTrue(answer.message)
        self.assertEqual(self.revision(), self.first.revision)

    @contextlib.contextmanager
    def loaded(self, *options):
        """Load the scan with other options, and restore it at the end."""
        def load(options):
            before = self.topologies[-1].revision
            answer = call("load_scan", LoadScan, "phantom:72x48x60", "", list(options))
            self.assertTrue(answer.success, answer.message)
            type(self).first = wait_for(lambda: self.topologies[-1] if self.topologies[-1].revision > before else None,
                                        "the mesh", SECONDS)
        try:
            load(options)
            yield
        finally:
            self.tool.reset()
            load([])
            self.assertEqual(len(self.first.tetrahedra), len(self.topologies[0].tetrahedra))

    def parts_while(self, on, off, what):
        """Cut nothing while the blade is off, cut along its path while it is on, and then nothing again."""
        self.appear([0.85 * self.low[0] + 0.15 * self.high[0], 0, self.height])
        self.sweep(0.2)
        self.assertFalse(self.state.fresh().tools[0].cuts)
        whole = self.revision()
        on()
        wait_for(lambda: self.state.fresh().tools[0].cuts, what + " to switch it on")
        self.sweep(0.28)
        wait_for(lambda: self.revision() > whole and self.cut.message.severed_area > 0, "tissue to part")
        off()
        wait_for(lambda: not self.state.fresh().tools[0].cuts, what + " to switch it off")
        cut = self.revision()
        self.sweep(0.33)
        self.assertEqual(self.revision(), cut, "nothing more")
        self.tool.reset()

    def test_what_switches_the_blade(self):
        def load(trigger):
            answer = call("load_scan", LoadScan, "phantom:72x48x60", "",
                          ["mesh/coarse_cells=6 5 5", "cut/trigger=" + trigger])
            self.assertTrue(answer.success, answer.message)
            wait_for(lambda: not self.state.fresh().tools[0].present, "the knife to be away")
        with self.loaded("cut/trigger=energy", "mesh/coarse_cells=6 5 5"):
            self.parts_while(lambda: self.energy.publish(Joy(buttons=[1])),
                             lambda: self.energy.publish(Joy(buttons=[0])), "the pedal")
            load("jaw")
            self.parts_while(lambda: setattr(self.tool, "closed", True), lambda: setattr(self.tool, "closed", False),
                             "the jaw")
            load("always")
            self.appear([self.low[0] - 0.01, 0, self.height])  # without pedal, jaw and command
            self.assertTrue(self.state.fresh().tools[0].cuts)
            whole = self.revision()
            self.sweep(0.1)
            wait_for(lambda: self.revision() > whole and self.cut.message.severed_area > 0, "tissue to part")

    def test_a_cut_that_is_pulled_open_is_seen_and_saved(self):
        """Check triangles, points and a slice in rviz without our plugins, and the saved volume."""
        def saved(name):
            answer = call("save_volume", SaveVolume, name)
            self.assertTrue(answer.success, answer.message)
            return nifti_voxels(self.folder + "/" + name)

        def gap(before, now):
            """Return the background pixels or voxels that were tissue, with tissue above and below. The first axis
            is along the body."""
            tissue = now > -300
            between = numpy.maximum.accumulate(tissue, axis=0) & numpy.maximum.accumulate(tissue[::-1], axis=0)[::-1]
            return int(((before > -300) & (now == -1000) & between).sum())

        def pixels():
            """Return the newest slice. A volume is sent when it changes."""
            image = shown["volume/slice/sagittal"].message
            return numpy.frombuffer(image.data, dtype=numpy.float32).reshape(image.height, image.width)

        def follows(topology):
            """Return whether marker and points have the nodes and triangles of this topology."""
            wait_for(lambda: len(shown["mesh/marker"].fresh().points) == len(topology.triangles), "mesh/marker")
            wait_for(lambda: shown["mesh/points"].fresh().width == len(topology.rest_parent), "mesh/points")
        shown = {topic: Latest(topic, kind) for topic, kind in (("mesh/marker", Marker), ("mesh/points", PointCloud2),
                                                                ("volume/slice/sagittal", Image))}
        grasper, contact = Tool("grasper", "tissue"), Latest("grasper/contact", ContactState)
        self.addCleanup(lambda: [latest.close() for latest in list(shown.values()) + [contact]])
        self.addCleanup(grasper.reset)
        whole, slice_of_whole = (saved("whole.nii.gz"),
                                 wait_for(lambda: shown["volume/slice/sagittal"].message and pixels(), "the slice"))
        follows(self.first)
        answer = self.cut_line()
        self.assertTrue(answer.success, answer.message)
        topology = self.wait_for_revision(answer.revision)
        self.assertGreater(len(topology.triangles), len(self.first.triangles))
        self.assertGreater(len(topology.rest_parent), len(self.first.rest_parent))
        follows(topology)
        numpy.testing.assert_array_equal(saved("closed.nii.gz"), whole, "a cut that stays closed shows nothing")
        grasper.appear([0, self.low[1] + 0.04, self.height + 0.01])
        grasper.take_hold(contact)
        for _ in range(15):
            grasper.position[2] += 0.002
            self.state.fresh()
        wait_for(lambda: gap(slice_of_whole, pixels()) > 10, "a gap in the slice")
        self.assertGreater(gap(whole, saved("open.nii.gz")), 100)
        grasper.reset()
        self.assertTrue(call("undo_cut", Trigger).success)
        follows(self.wait_for_revision(self.first.revision))
        wait_for(lambda: numpy.abs(pixels() - slice_of_whole).max() < 100, "the slice to be as before")

    # ---- a recorded session

    def run_bag(self, kind, *arguments):
        scene = ["--scan", "phantom:72x48x60"]
        for option in ("mesh/coarse_cells=12 9 10", "mesh/ratio=1", "cut/kind=" + kind, "cut/resistance=0",
                       "material/file=" + rospy.get_param(NAMESPACE + "sim/material/file")):
            scene += ["--set", option]
        done = subprocess.run(["pliant_bag", self.folder + "/session.bag"] + scene + list(arguments),
                              stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, universal_newlines=True, timeout=4 * SECONDS)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def test_a_recorded_session_is_cut_again(self):
        self.record_and_cut_again("sever")

    def test_a_recorded_session_is_subdivided_again(self):
        with self.loaded("cut/kind=subdivide"):
            topology = self.record_and_cut_again("subdivide")
            self.assertEqual(len(topology.severed), 0)
            self.assertEqual(len(topology.tetrahedron_parent), len(topology.material) - len(self.first.material))
            self.assertEqual(len(topology.between_share), len(topology.rest_parent) - len(self.first.rest_parent))
            self.assertGreater(sum(0 < share < 1 for share in topology.between_share),
                               0.3 * len(topology.between_share), "nodes on edges")
            self.assertEqual(len(large_pieces(topology)), 2)
            self.assertTrue(call("undo_cut", Trigger).success)
            self.assertTrue(call("undo_cut", Trigger).success)
            self.assertEqual(self.wait_for_revision(self.first.revision).tetrahedra, self.first.tetrahedra)

    def record_and_cut_again(self, kind):
        """Cut a stroke, undo it, cut with the service, and cut the rest with a stroke. Return the last topology."""
        recorder = Launch("record.launch", bag=self.folder + "/session.bag")
        try:
            for topic in ("mesh/topology", "mesh/state", "step", "knife/cut", "cut"):
                wait_for(lambda: is_sent("sim", topic, "/record_tissue"), "the recorder", SECONDS)
            self.assertTrue(call("reset", Trigger).success)
            self.stroke(0.6)
            self.assertTrue(call("undo_cut", Trigger).success)
            answer = self.cut_line()
            self.assertTrue(answer.success, answer.message)
            self.wait_for_revision(answer.revision)
            topology = self.stroke(0.3)
            time.sleep(0.5)
        finally:
            recorder.stop()
        # the volume of a state from its topology alone, and from the recomputed session, at a time that no step follows
        # immediately
        with rosbag.Bag(self.folder + "/session.bag") as bag:
            start = bag.get_start_time()
            steps = [(when.to_sec() - start, message.header.stamp)
                     for _, message, when in bag.read_messages(NAMESPACE + "step")]
            states = [(when.to_sec() - start, message.header.stamp, message.revision)
                      for _, message, when in bag.read_messages(NAMESPACE + "mesh/state")]
        self.assertGreater(len(set(revision for _, _, revision in states)), 5)

        def is_settled(time):
            """Return whether the newest state belongs to the newest step, and no message follows within a
            millisecond."""
            state, step = ([entry for entry in entries if entry[0] <= time][-1] for entries in (states, steps))
            return state[1] == step[1] and not any(time < entry[0] < time + 1e-3 for entry in states + steps)
        last = next(time for time in (when + 1e-3 for when, _, _ in reversed(states[len(states) // 2:-1]))
                    if is_settled(time))
        at = ["--at", "%.6f" % last]
        self.run_bag(kind, *at, "--surfaces", "--out", self.folder + "/states")
        printed = self.run_bag(kind, *at, "--simulate", "--out", self.folder + "/again", "--cuts",
                            self.folder + "/cuts.csv")
        self.assertIn("each bitwise equal to the recording", printed)
        with open(self.folder + "/cuts.csv") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual(set(row["tool"] for row in rows), {"knife", ""})
        self.assertGreater(max(float(row["severed_area_m2"]) for row in rows), 0)
        surface, = [name for name in os.listdir(self.folder + "/states") if name.endswith(".ply")]
        with open(os.path.join(self.folder, "states", surface)) as file:
            self.assertTrue(any(line.startswith("3 ") and line.endswith(" 1\n") for line in file),
                            "faces that cuts have made")
        name = os.listdir(self.folder + "/again")[0]
        numpy.testing.assert_array_equal(nifti_voxels(self.folder + "/states/" + name),
                                         nifti_voxels(self.folder + "/again/" + name))
        for folder in ("states", "again"):
            shutil.rmtree(os.path.join(self.folder, folder))
        return topology


if __name__ == "__main__":
    rostest.rosrun("pliant", "cut", CutTest)
