"""What the tests of the node share: the latest message of a topic, a tool that moves, a volume out of boxes."""
import threading
import time

import numpy
import rospy
from geometry_msgs.msg import PoseStamped
from pliant.msg import ContactState, MeshState, MeshTopology, ScanInfo, SimState, Volume
from pliant.srv import LoadScan, RecomputeHomogenization, SetMaterials
from sensor_msgs.msg import JointState

NAMESPACE = "/tissue/"
TIMEOUT = 30.0  # seconds that anything may take on a busy machine


def wait_for(condition, what, timeout=TIMEOUT):
    """Poll until condition() is true or not None; its value."""
    end = time.time() + timeout
    while time.time() < end and not rospy.is_shutdown():
        value = condition()
        if value is not None and value is not False:
            return value
        time.sleep(0.02)
    raise AssertionError("waited %g s in vain for %s" % (timeout, what))


def call(name, kind, *arguments):
    rospy.wait_for_service(NAMESPACE + name, 30)
    return rospy.ServiceProxy(NAMESPACE + name, kind)(*arguments)


class Latest:
    """The newest message of a topic, and how many there were."""

    def __init__(self, topic, kind):
        self.message, self.count = None, 0
        self.topic = topic
        self.subscriber = rospy.Subscriber(NAMESPACE + topic, kind, self.take, queue_size=1, buff_size=1 << 26)

    def take(self, message):
        self.message = message
        self.count += 1

    def since(self, start):
        """The newest message, once it is one that was made at the time of start or later."""
        return wait_for(lambda: self.message if self.message and self.message.header.stamp >= start else None,
                        "what is newer on " + self.topic)

    def fresh(self, timeout=TIMEOUT):
        """The second message from now: the first may have been under way already."""
        count = self.count
        wait_for(lambda: self.count >= count + 2, "fresh messages on " + self.topic, timeout)
        return self.message

    def close(self):
        self.subscriber.unregister()


class Tool:
    """Sends measured_cp and jaw/measured_js at 100 Hz, as long as it is switched on."""

    def __init__(self, name, frame):
        self.position, self.frame, self.closed = [0.0, 0.0, 0.0], frame, False
        self.is_on, self.with_jaw = False, True
        self.stamp = rospy.Time.now  # tests put wrong clocks in its place
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
        """With an open jaw, and seen so by the node: a jaw takes hold as it closes."""
        self.position, self.closed, self.is_on = list(position), False, True
        wait_for(lambda: self.pose.get_num_connections() and self.jaw.get_num_connections(), "the node to listen")
        time.sleep(0.2)

    def send(self):
        pose, jaw = PoseStamped(), JointState()
        pose.header.stamp = jaw.header.stamp = self.stamp()
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
        self.is_on, self.closed, self.with_jaw, self.stamp = False, False, True, rospy.Time.now


class WholeVolume:
    """Boxes put into the volume received before."""

    def __init__(self):
        self.voxels, self.header_of_last, self.sequences, self.gaps = None, None, [], 0
        self.lock = threading.Lock()
        self.subscriber = rospy.Subscriber(NAMESPACE + "volume", Volume, self.take, queue_size=32, buff_size=1 << 27)

    def take(self, message):
        types = {Volume.UINT8: numpy.uint8, Volume.INT16: numpy.int16, Volume.FLOAT32: numpy.float32}
        size = tuple(reversed(message.size))
        box = numpy.frombuffer(message.data, dtype=types[message.encoding]).reshape(size)
        with self.lock:
            if self.sequences and message.sequence != self.sequences[-1] + 1:
                self.gaps += 1
            self.sequences.append(message.sequence)
            self.header_of_last = message
            if message.size == message.full_size:
                self.voxels = box.copy()
            elif self.voxels is not None:
                i, j, k = message.offset
                self.voxels[k:k + size[0], j:j + size[1], i:i + size[2]] = box

    def copy(self):
        with self.lock:
            return None if self.voxels is None else self.voxels.copy()

    def close(self):
        self.subscriber.unregister()


class Node:
    """Subscriptions that every test needs."""

    def __init__(self):
        self.state = Latest("state", SimState)
        self.info = Latest("scan_info", ScanInfo)
        self.topology = Latest("mesh/topology", MeshTopology)
        self.mesh = Latest("mesh/state", MeshState)
        self.contact = Latest("grasper/contact", ContactState)

    def wait_until_running(self):
        wait_for(lambda: self.state.message and self.state.message.state == SimState.RUNNING and
                 not self.state.message.is_busy, "the simulation to run", 60)
        wait_for(lambda: self.topology.message, "the topology")

    def asked(self, name, kind, *arguments):
        """The answer of a call that puts in another model. Its scan_info and topology are here then, and it runs: what
        is told of a model goes another way than the answer, and may come after it."""
        start = rospy.Time.now()
        answer = call(name, kind, *arguments)
        if answer.success:
            self.info.since(start)
            self.topology.since(start)
            self.wait_until_running()
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
        """Largest of any node [m], from a state that fits the topology."""
        def matching():
            state = self.mesh.fresh()
            return state if state.revision == self.topology.message.revision else None
        nodes = numpy.array(wait_for(matching, "a mesh state of this revision").nodes).reshape(-1, 3)
        return float(numpy.max(numpy.linalg.norm(nodes - self.rest(), axis=1)))

    def front(self):
        """A point well inside the tissue in the middle of the front: the centroid of a tetrahedron 2 cm deep."""
        rest = self.rest()
        centroids = rest[numpy.array(self.topology.message.tetrahedra).reshape(-1, 4)].mean(axis=1)
        middle = 0.5 * (rest.min(axis=0) + rest.max(axis=0))
        aside = numpy.abs(centroids[:, 0] - middle[0]) + numpy.abs(centroids[:, 2] - middle[2])
        column = centroids[aside < numpy.sort(aside)[max(20, len(aside) // 50)]]
        foremost = column[:, 1].min()
        return column[numpy.argmin(numpy.abs(column[:, 1] - foremost - 0.02))]
