#!/usr/bin/env python3
"""Simulate two hosts with a bad network between them, in network namespaces. One is a robot's console with the master
and force_guard, and the other one runs the tissue. First the link is good. Then it loses 5 % of its packets and
delays the others by 200 ms in each direction. Then it is good again.

    source build/devel/setup.bash; sudo -E test/bench/two_hosts.py [LOSS=5] [MILLISECONDS=200] [SECONDS=6]

The program prints for each period: steps per second, how often the tool was present, the forces on the hand, and the
diagnostics. It fails if the simulation stops, if a force reaches the hand more than 50 ms after the guard's last
valid input, or if the tool does not return. It needs root, `ip netns` and /dev/net/tun, and reports if they are
missing."""
import ctypes
import fcntl
import heapq
import json
import os
import random
import select
import struct
import subprocess
import sys
import threading
import time

LOSS, DELAY, SECONDS = (float(sys.argv[i]) if len(sys.argv) > i else default
                        for i, default in ((1, 5), (2, 200), (3, 6)))
CONSOLE, TISSUE = ("pliant_console", "10.213.7.1"), ("pliant_tissue", "10.213.7.2")
MASTER = "http://%s:11399" % CONSOLE[1]

OBSERVER = r'''
import json, sys, threading, time
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from pliant.msg import ContactState, Step
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
at_console = sys.argv[1] == "console"
rospy.init_node("observer_" + sys.argv[1])
lock, now = threading.Lock(), {}
def count(name, value=1):
    with lock:
        now[name] = now.get(name, 0) + value
inputs, late = [0.0, 0.0], [0.0]
def hand(message):
    force = abs(message.wrench.force.x) + abs(message.wrench.force.y) + abs(message.wrench.force.z)
    count("hand's messages")
    if force > 0:
        count("of those a force")
        with lock:
            now["latest force [ms]"] = max(now.get("latest force [ms]", 0), 1e3 * (time.time() - min(inputs)))
def told(message):
    for status in message.status:
        if at_console == ("force_guard" in status.name) and ("tool" in status.name or "guard" in status.name):
            with lock:
                now.setdefault("said", {})[status.message[:90]] = 1
if at_console:
    # the hand pulls: a point 2 cm out, with the jaw closed
    servo = rospy.Publisher("/PSM1/servo_cp", PoseStamped, queue_size=1, latch=True)
    jaw = rospy.Publisher("/PSM1/jaw/servo_jp", JointState, queue_size=1, latch=True)
    follow = rospy.Publisher("/MTMR_PSM1/following", Bool, queue_size=1, latch=True)
    follow.publish(True)
    rospy.Subscriber("/MTMR/body/servo_cf", WrenchStamped, hand, queue_size=100)
    rospy.Subscriber("/PSM1/measured_cp", PoseStamped,
                     lambda message: inputs.__setitem__(0, time.time()), tcp_nodelay=True)
    rospy.Subscriber("/tissue/PSM1/measured_cf", WrenchStamped,
                     lambda message: inputs.__setitem__(1, time.time()), tcp_nodelay=True)
else:
    rospy.Subscriber("/tissue/step", Step, lambda message: count("steps"))
    rospy.Subscriber("/tissue/PSM1/contact", ContactState, lambda message: (
        count("contacts"), count("of those present", int(message.present)),
        count("of those held", int(message.grasped))))
rospy.Subscriber("/diagnostics", DiagnosticArray, told)
def go(place, closed):
    message = PoseStamped()
    message.pose.position.x, message.pose.position.y, message.pose.position.z = place
    message.pose.orientation.w = 1
    servo.publish(message)
    jaw.publish(JointState(position=[0.0 if closed else 0.6]))
for line in sys.stdin:
    words = line.split()
    if words[0] == "go":
        go([float(word) for word in words[1:4]], words[4] == "closed")
        print("{}", flush=True)
    else:
        with lock:
            print(json.dumps(now), flush=True)
            now.clear()
'''


def run(*command):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)


class Link:
    """A link between the two namespaces: it passes packets from one tun device to the other, drops some, and delays
    the rest."""

    def __init__(self):
        self.loss = self.delay = 0
        self.random, self.waiting, self.ends = random.Random(1), [], []
        libc, home = ctypes.CDLL(None, use_errno=True), os.open("/proc/self/ns/net", os.O_RDONLY)
        for name, address in (CONSOLE, TISSUE):
            with open("/run/netns/" + name) as namespace:
                if libc.setns(namespace.fileno(), 0) != 0:
                    raise OSError(ctypes.get_errno(), "setns")
            end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
            fcntl.ioctl(end, 0x400454CA, struct.pack("16sH", b"bad0", 0x1001))  # TUNSETIFF: IFF_TUN, IFF_NO_PI
            libc.setns(home, 0)
            for command in ("ip addr add %s/24 dev bad0" % address, "ip link set bad0 up", "ip link set lo up"):
                subprocess.check_call(["ip", "netns", "exec", name] + command.split())
            self.ends.append(end)
        threading.Thread(target=self.carry, daemon=True).start()

    def carry(self):
        while True:
            wait = max(0, self.waiting[0][0] - time.monotonic()) if self.waiting else 1
            for end in select.select(self.ends, [], [], wait)[0]:
                packet, other = os.read(end, 65536), self.ends[1 - self.ends.index(end)]
                if self.random.random() >= self.loss:
                    heapq.heappush(self.waiting, (time.monotonic() + self.delay, self.random.random(), other, packet))
            while self.waiting and self.waiting[0][0] <= time.monotonic():
                _, _, other, packet = heapq.heappop(self.waiting)
                try:
                    os.write(other, packet)
                except BlockingIOError:
                    pass  # full: lost


def make_hosts():
    for name, _ in (CONSOLE, TISSUE):
        done = run("ip", "netns", "add", name)
        if done.returncode != 0 or not os.path.exists("/dev/net/tun"):
            remove_hosts()
            sys.exit("skipped: " + (done.stdout.strip() or "there is no /dev/net/tun"))
    return Link()


def remove_hosts():
    for name, _ in (CONSOLE, TISSUE):
        run("ip", "netns", "del", name)


def start(host, *command, **more):
    environment = dict(os.environ, ROS_MASTER_URI=MASTER, ROS_IP=host[1], OMP_WAIT_POLICY="passive")
    environment.pop("ROS_HOSTNAME", None)
    return subprocess.Popen(["ip", "netns", "exec", host[0]] + list(command), env=environment, universal_newlines=True,
                            **more)


def ask(observer, words):
    observer.stdin.write(words + "\n")
    observer.stdin.flush()
    return json.loads(observer.stdout.readline())


def program(name):
    return (subprocess.check_output(["catkin_find", "--first-only", "pliant", name], universal_newlines=True).strip()
            or name)


def operate(link, processes):
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    begin = lambda *arguments, **more: processes.append(start(*arguments, **more)) or processes[-1]
    begin(CONSOLE, "rosmaster", "--core", "-p", "11399", **quiet)
    time.sleep(3)
    begin(TISSUE, program("pliant_node"), "__ns:=tissue", "__name:=sim", "_scan/path:=phantom:72x48x60", "_tools:=PSM1",
          "_parent_frame:=PSM1_base",
          "_tissue_pose:=0 0 -0.2 0 0 0 1", "_grasp/radius:=0.01", "PSM1/measured_cp:=/PSM1/measured_cp",
          "PSM1/jaw/measured_js:=/PSM1/jaw/measured_js", **quiet)
    begin(CONSOLE, program("sim_robot"), **quiet)
    begin(CONSOLE, program("force_guard"), "__ns:=tissue", "_tool:=PSM1", "_haptic:=true",
          "PSM1/measured_cp:=/PSM1/measured_cp",
          "following:=/MTMR_PSM1/following", "servo_cf:=/MTMR/body/servo_cf", **quiet)
    console, tissue = (begin(host, sys.executable, "-c", OBSERVER, name, **pipes)
                       for host, name in ((CONSOLE, "console"), (TISSUE, "tissue")))
    time.sleep(4)
    inside = [0.05, -0.09, 0.06 - 0.2]
    told = {}
    for name in ("good", "bad", "good again"):
        link.loss, link.delay = (0.01 * LOSS, 0.001 * DELAY) if name == "bad" else (0, 0)
        ask(console, "go %g %g %g open" % tuple(inside))
        time.sleep(2)
        ask(console, "go %g %g %g closed" % tuple(inside))
        time.sleep(0.5)
        ask(console, "go %g %g %g closed" % (inside[0], inside[1] - 0.01, inside[2]))
        time.sleep(1)
        ask(console, "tell"), ask(tissue, "tell")
        time.sleep(SECONDS)
        told[name] = dict(ask(tissue, "tell"), console=ask(console, "tell"))
        print("%s: %s" % (name, json.dumps(told[name])), flush=True)
    good, bad, again = (told[name] for name in ("good", "bad", "good again"))
    failures = ["no steps while the link is " + name for name in told if told[name].get("steps", 0) < 0.5 *
                good["steps"]]
    failures += ["the tool is not there while the link is " + name for name in ("good", "good again")
                 if not told[name].get("of those present")]
    latest = max(part["console"].get("latest force [ms]", 0) for part in (good, bad, again))
    if latest > 90:  # 40 ms of timeout, 50 ms until zero
        failures.append("a force reached the hand %.0f ms after the last input" % latest)
    return failures


def main():
    link = make_hosts()
    processes = []
    try:
        failures = operate(link, processes)
    finally:
        for process in processes:
            process.kill()
            process.wait()
        remove_hosts()
    print("\n".join(failures) or "good")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
