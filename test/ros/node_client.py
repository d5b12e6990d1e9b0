"""Shared code of the node's tests: the latest message of a topic, a moving tool, and a volume assembled from boxes.
Messages on different topics, and old messages, may arrive at any time. So the code waits for a stamp or an
identifier."""
import gzip
import os
import resource
import signal
import struct
import subprocess
import tempfile
import threading
import time
import xmlrpc.client

import numpy
import rosgraph
import rospy
from geometry_msgs.msg import PoseStamped
from pliant.msg import ContactState, MeshState, MeshTopology, ScanInfo, SimState, Volume
from pliant.srv import LoadScan, RecomputeHomogenization, SetMaterials
from sensor_msgs.msg import JointState

NAMESPACE = "/tissue/"
TIMEOUT = 30.0  # time limit on a busy machine [s]


def wait_for(condition, what, timeout=TIMEOUT, pause=0.02):
    """Poll until condition() returns true or an array. Return its value."""
    end = time.time() + timeout
    while time.time() < end and not rospy.is_shutdown():
        value = condition()
        if isinstance(value, numpy.ndarray) or value:
            return value
        time.sleep(pause)
    raise AssertionError("waited %g s in vain for %s" % (timeout, what))


def call(name, kind, *arguments):
    rospy.wait_for_service(NAMESPACE + name, 30)
    return rospy.ServiceProxy(NAMESPACE + name, kind)(*arguments)


def is_sent(node, topic, reader):
    """Return whether a node reports a connection of one of its topics to a reader."""
    address = rosgraph.Master("/node_client").lookupNode(NAMESPACE + node)
    code, text, connections = xmlrpc.client.ServerProxy(address).getBusInfo("/node_client")
    assert code == 1, text
    return any(to == reader and way == "o" and name == NAMESPACE + topic for _, to, way, _, name, *_ in connections)


def resident_bytes(node):
    """Return the resident memory of a node."""
    code, text, process = xmlrpc.client.ServerProxy(rosgraph.Master("/node_client").lookupNode(
        NAMESPACE + node)).getPid("/node_client")
    assert code == 1, text
    with open("/proc/%d/statm" % process) as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def nifti_voxels(path):
    """Return the 16-bit voxels (slices, rows, columns)."""
    with gzip.open(path) as file:
        data = file.read()
    size = struct.unpack_from("<8h", data, 40)[1:4]
    offset = int(struct.unpack_from("<f", data, 108)[0])
    assert struct.unpack_from("<h", data, 70)[0] == 4, "int16"
    return numpy.frombuffer(data, dtype="<i2", offset=offset).reshape(tuple(reversed(size)))


class Launch:
    """roslaunch of a file of the package, with the master of this test. log() returns its output."""

    def __init__(self, name, **arguments):
        command = ["roslaunch", "pliant", name] + ["%s:=%s" % pair for pair in arguments.items()]
        self.output = tempfile.TemporaryFile("w+", errors="replace")
        # otherwise roslaunch's output to a file would appear only at its end
        unbuffered = dict(os.environ, PYTHONUNBUFFERED="1")
        self.process = subprocess.Popen(command, start_new_session=True, stdout=self.output, stderr=subprocess.STDOUT,
                                        env=unbuffered)

    def log(self):
        size = os.fstat(self.output.fileno()).st_size
        return os.pread(self.output.fileno(), size, 0).decode(errors="replace")

    def stop(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(60)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            raise AssertionError("roslaunch does not end")
        finally:
            print(self.log())


class Latest:
    """The newest message of a topic."""

    def __init__(self, topic, kind):
        self.message, self.topic = None, topic
        name = topic if topic.startswith("/") else NAMESPACE + topic
        self.subscriber = rospy.Subscriber(name, kind, self.take, queue_size=1, buff_size=1 << 26)

    def take(self, message):
        self.message = message

    def since(self, start):
        """Wait for a message with this time stamp or a later one. Return it."""
        return wait_for(lambda: self.message if self.message and self.message.header.stamp >= start else None,
                        "what is newer on " + self.topic)

    def fresh(self):
        """Wait for a message that is made after this call: older ones may still arrive. Return it."""
        return self.since(rospy.Time.now())

    def close(self):
        self.subscriber.unregister()


class Tool:
    """Publishes measured_cp and jaw/measured_js at 100 Hz, while is_on is true."""

    def __init__(self, name, frame):
        self.position, self.frame, self.closed = [0.0, 0.0, 0.0], frame, False
        self.is_on, self.with_jaw = False, True
        self.stamp = rospy.Time.now  # tests replace it to simulate wrong clocks
        self.pose_age = 0  # age of poses relative to jaws [s]
        self.pose = rospy.Publisher(NAMESPACE + name + "/measured_cp", PoseStamped, queue_size=1)
        self.jaw = rospy.Publisher(NAMESPACE + name + "/jaw/measured_js", JointState, queue_size=1)
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        while not rospy.is_shutdown():
            if self.is_on:
                self.send()
            time.sleep(0.01)

    def appear(self, position):
        """Appear with an open jaw."""
        self.position, self.closed, self.is_on = list(position), False, True
        wait_for(lambda: self.pose.get_num_connections() and self.jaw.get_num_connections(), "the node to listen")

    def take_hold(self, contact):
        """Close the jaw until contact reports a grasp. The node grasps when it has received an open jaw before the
        closed one, but it does not confirm the open jaw. On a busy machine the tool may be absent for a moment.
        Then the jaw opens for longer and closes again."""
        open_for = 0.2
        while True:
            self.closed = False
            time.sleep(open_for)
            self.closed = True
            try:
                wait_for(lambda: contact.fresh().grasped, "the tool to take hold", 5 * open_for)
                return
            except AssertionError:
                if open_for > TIMEOUT / 10:
                    raise
            open_for *= 2

    def send(self):
        pose, jaw = PoseStamped(), JointState()
        pose.header.stamp = jaw.header.stamp = self.stamp()
        if self.pose_age:
            pose.header.stamp -= rospy.Duration(self.pose_age)
        pose.header.frame_id = self.frame
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = self.position
        pose.pose.orientation.w = 1.0
        jaw.position = [0.0 if self.closed else 0.5]
        try:
            self.pose.publish(pose)
            if self.with_jaw:
                self.jaw.publish(jaw)
        except rospy.ROSException:
            pass  # shutting down

    def reset(self):
        self.is_on, self.closed, self.with_jaw, self.stamp, self.pose_age = False, False, True, rospy.Time.now, 0


class WholeVolume:
    """Assemble the volume from boxes of changes. A slow subscriber misses boxes. Then it subscribes again and
    receives the whole volume."""

    def __init__(self):
        self.lock = threading.Lock()
        self.subscribe()

    def subscribe(self):
        self.voxels, self.sequence, self.since_whole, self.is_lost, self.bytes, self.message = (
            None, None, 0, False, 0, None)
        self.subscriber = rospy.Subscriber(NAMESPACE + "volume", Volume, self.take, buff_size=1 << 27)

    def take(self, message):
        types = {Volume.UINT8: numpy.uint8, Volume.INT16: numpy.int16, Volume.FLOAT32: numpy.float32}
        size = tuple(reversed(message.size))
        box = numpy.frombuffer(message.data, dtype=types[message.encoding]).reshape(size)
        with self.lock:
            self.is_lost = self.is_lost or self.sequence is not None and message.since > self.sequence
            self.sequence = message.sequence
            self.bytes += len(message.data)
            self.message = message
            if message.size == message.full_size:
                self.voxels, self.since_whole = box.copy(), 0
            elif self.voxels is not None:
                i, j, k = message.offset
                self.voxels[k:k + size[0], j:j + size[1], i:i + size[2]] = box
                self.since_whole += 1

    def copy(self):
        """Return a copy of the voxels, or None before the first volume."""
        with self.lock:
            if not self.is_lost:
                return None if self.voxels is None else self.voxels.copy()
        self.close()
        self.subscribe()
        return None

    def when(self, condition, what):
        """Return the first copy that fulfils the condition."""
        def look():
            voxels = self.copy()
            return voxels if voxels is not None and condition(voxels) else None
        return wait_for(look, what)

    def close(self):
        """Unsubscribe, and wait until the node has noticed it."""
        self.subscriber.unregister()
        wait_for(lambda: not is_sent("sim", "volume", rospy.get_name()), "the node to see that nobody looks")


class Node:
    """Subscriptions that every test needs."""

    def __init__(self, tool="grasper", namespace=NAMESPACE):
        self.state = Latest(namespace + "state", SimState)
        self.info = Latest(namespace + "scan_info", ScanInfo)
        self.topology = Latest(namespace + "mesh/topology", MeshTopology)
        self.mesh = Latest(namespace + "mesh/state", MeshState)
        self.contact = Latest(namespace + tool + "/contact", ContactState)

    def wait_until_running(self, start=rospy.Time(0)):
        """Wait until the state is RUNNING and the model's messages have this time stamp or a later one."""
        def runs():
            state = self.state.message
            return state and state.header.stamp >= start and state.state == SimState.RUNNING and not state.is_busy
        wait_for(runs, "the simulation to run", 60)
        self.info.since(start)
        self.topology.since(start)

    def goes_on(self):
        """Check that new steps follow and none fails."""
        step = self.mesh.fresh().step
        wait_for(lambda: self.mesh.fresh().step > step, "further steps")
        wait_for(lambda: self.state.message.state == SimState.RUNNING, "RUNNING")

    def asked(self, name, kind, *arguments):
        """Call a service that replaces the model. Return the answer after scan_info and topology have arrived and
        the simulation runs. The model's messages have another connection than the answer, so they may arrive
        later."""
        start = rospy.Time.now()
        answer = call(name, kind, *arguments)
        if answer.success:
            self.wait_until_running(start)
        return answer

    def load(self, path, labels="", options=()):
        return self.asked("load_scan", LoadScan, path, labels, list(options))

    def recompute(self, method="", cells=(0, 0, 0), ratio=0, probe=False):
        return self.asked("recompute_homogenization", RecomputeHomogenization, method, list(cells), ratio, probe)

    def set_materials(self, yaml):
        return self.asked("set_materials", SetMaterials, yaml)

    def rest(self):
        return numpy.array(self.topology.message.rest_nodes).reshape(-1, 3)

    def displacement(self):
        """Return the maximum displacement of a node [m], from a state that matches the topology."""
        def matching():
            state = self.mesh.fresh()
            return state if state.revision == self.topology.message.revision else None
        nodes = numpy.array(wait_for(matching, "a mesh state of this revision").nodes).reshape(-1, 3)
        return float(numpy.max(numpy.linalg.norm(nodes - self.rest(), axis=1)))

    def front(self):
        """Return a point inside the tissue in the middle of the front: the centroid of a tetrahedron 2 cm deep."""
        rest = self.rest()
        centroids = rest[numpy.array(self.topology.message.tetrahedra).reshape(-1, 4)].mean(axis=1)
        middle = 0.5 * (rest.min(axis=0) + rest.max(axis=0))
        aside = numpy.abs(centroids[:, 0] - middle[0]) + numpy.abs(centroids[:, 2] - middle[2])
        column = centroids[aside < numpy.sort(aside)[max(20, len(aside) // 50)]]
        foremost = column[:, 1].min()
        return column[numpy.argmin(numpy.abs(column[:, 1] - foremost - 0.02))]
