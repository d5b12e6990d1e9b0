#!/usr/bin/env python3
"""Measure the speed of the rviz displays under Xvfb with Mesa's software rendering. Needs the build's setup.bash.

  rviz_speed.py frames [--slices 96 256] [--rendering Slices] [--preset NAME] [--size 128x128x128 ...]
      frames per second and processor time of rviz for the phantom at rest, in a view of 800 x 600 pixels
  rviz_speed.py moving [...]      the same while a tool pulls the phantom back and forth, 10 volumes per second
  rviz_speed.py delay [--repeat 20]
      time from the pose of a tool to a picture that it has changed
"""
import argparse
import multiprocessing
import os
import sys
import time

import numpy

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "ros"))
import rviz_stage  # noqa: E402

SCENE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "launch", "scenes", "demo.yaml")
# a point on the front of the belly, and its displacement [m]
HOLD, WAY = numpy.array([-0.054, -0.063, 0.063]), numpy.array([0.0, -0.03, 0.0])
VIEW = {"Class": "rviz/Orbit", "Distance": 0.6, "Yaw": 4.7, "Pitch": 0.2, "Near Clip Distance": 0.01}
# size of rviz's window without the 3-D view
BESIDE, ABOVE = 32, 91


def display(arguments, slices):
    return """
- Class: pliant/Volume
  Name: volume
  Enabled: true
  Topic: tissue/volume
  Rendering: %s
  Preset: %s
  Slices: %d
  Slices While Moving: %d
""" % (arguments.rendering, arguments.preset, slices, slices)


def open_stage(arguments, slices, size, scene=(), rate=30):
    # Mesa writes the frame rate of rviz every half second
    os.environ.update(GALLIUM_HUD="fps", GALLIUM_HUD_PERIOD="0.5", GALLIUM_HUD_VISIBLE="false")
    stage = rviz_stage.Stage(rviz_stage.config(display(arguments, slices), VIEW, rate=rate), 800 + BESIDE, 600 + ABOVE)
    os.environ["GALLIUM_HUD_DUMP_DIR"] = stage.folder
    stage.__enter__()
    stage.start([rviz_stage.program("pliant_node"), "__ns:=tissue", "_scene:=" + SCENE, "_scan/path:=phantom:" + size,
                 "_tools:=grasper", "_tool_max_age:=1.0"] + list(scene), "node")
    stage.wait_for(lambda p: (p[ABOVE:-30, 50:500].max(axis=2) > 60).mean() > 0.1, 120, "the phantom")
    return stage


def seconds_used(stage, name):
    with open("/proc/%d/stat" % stage.processes[name].pid) as stat:
        fields = stat.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(arguments, size, slices, moving):
    stage = open_stage(arguments, slices, size)
    try:
        tool = Tool(HOLD) if moving else None
        if moving:
            stage.wait(tool.grasp, 60, "the grasp")

        def pass_time(seconds):
            start = time.time()
            while time.time() < start + seconds:
                if moving:
                    tool.send(HOLD + WAY * 0.5 * (1 - numpy.cos(numpy.pi * (time.time() - start))))
                time.sleep(0.01)
        pass_time(2)
        rates = os.path.join(stage.folder, "fps")
        seen = os.path.getsize(rates)
        start, rviz, node = time.time(), seconds_used(stage, "rviz"), seconds_used(stage, "node")
        pass_time(arguments.seconds)
        took = time.time() - start
        with open(rates) as lines:
            lines.seek(seen)
            rate = numpy.mean([float(x) for x in lines.read().split()])
        print("%-12s %-10s %6d %9.1f %8.0f%% %8.0f%%" %
              (size, arguments.rendering, slices, rate, 100 * (seconds_used(stage, "rviz") - rviz) / took,
               100 * (seconds_used(stage, "node") - node) / took), flush=True)
    finally:
        stage.close()


def frames(arguments, moving):
    print("%-12s %-10s %6s %9s %9s %9s" % ("volume", "rendering", "slices", "frames/s", "rviz CPU", "node CPU"),
          flush=True)
    for size in arguments.size:
        for slices in arguments.slices:
            # in a separate process, because a process can have only one ROS node
            run = multiprocessing.Process(target=measure, args=(arguments, size, slices, moving))
            run.start()
            run.join()


class Tool:
    """A tool that publishes its pose and jaw. It grasps the tissue at its start position."""

    def __init__(self, start):
        import rospy
        from geometry_msgs.msg import PoseStamped
        from pliant.msg import ContactState
        from sensor_msgs.msg import JointState
        rospy.init_node("rviz_speed", disable_signals=True)
        self.rospy, self.grasped, self.closed = rospy, False, False
        self.pose, self.jaw = PoseStamped(), JointState(name=["jaw"])
        self.pose.header.frame_id = "tissue"
        self.pose.pose.orientation.w = 1
        self.poses = rospy.Publisher("tissue/grasper/measured_cp", PoseStamped, queue_size=1, tcp_nodelay=True)
        self.jaws = rospy.Publisher("tissue/grasper/jaw/measured_js", JointState, queue_size=1, tcp_nodelay=True)
        self.contact = rospy.Subscriber("tissue/grasper/contact", ContactState,
                                        lambda m: setattr(self, "grasped", m.grasped))
        self.start, self.began = start, time.time()

    def send(self, place):
        now = self.rospy.Time.now()
        self.pose.header.stamp = self.jaw.header.stamp = now
        p = self.pose.pose.position
        p.x, p.y, p.z = place
        self.jaw.position = [0.0 if self.closed else 0.5]
        self.jaws.publish(self.jaw)
        self.poses.publish(self.pose)

    def grasp(self):
        """Call this until it returns True: the tool has grasped the tissue."""
        self.closed = time.time() > self.began + 2
        self.send(self.start)
        return self.grasped


def delay(arguments):
    """Measure the time from a tool's pose to the first picture with other pixels around the tool. The tool jumps by
    30 mm, and a spring pulls the tissue."""
    stage = open_stage(arguments, arguments.slices[0], arguments.size[0])
    tool = Tool(HOLD)
    stage.wait(tool.grasp, 60, "the grasp")
    place, times = HOLD, []
    hold_until = time.time() + 3
    for n in range(2 * arguments.repeat):
        while time.time() < hold_until:
            tool.send(place)
            time.sleep(0.01)
        before, place = stage.picture(), HOLD + (WAY if n % 2 == 0 else 0)
        start = time.time()
        while time.time() < start + 10:
            tool.send(place)
            changed = (abs(stage.picture()[ABOVE:-30].astype(int) - before[ABOVE:-30]).max(axis=2) > 20).sum()
            if changed > 100:
                times.append(time.time() - start)
                break
            time.sleep(0.004)
        hold_until = time.time() + 2
    stage.close()
    times = 1000 * numpy.array(times)
    print("%s, %d slices: pose to changed picture, %d of %d: median %.0f ms, least %.0f, most %.0f" %
          (arguments.size[0], arguments.slices[0], len(times), 2 * arguments.repeat, numpy.median(times), times.min(),
           times.max()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["frames", "moving", "delay"])
    parser.add_argument("--size", nargs="+", default=["128x128x128", "256x160x122"])
    parser.add_argument("--slices", nargs="+", type=int, default=[96, 256])
    parser.add_argument("--rendering", default="Slices", choices=["Slices", "Isosurface"])
    parser.add_argument("--preset", default="CT abdomen")
    parser.add_argument("--seconds", type=float, default=8)
    parser.add_argument("--repeat", type=int, default=10)
    arguments = parser.parse_args()
    if arguments.what == "delay":
        delay(arguments)
    else:
        frames(arguments, arguments.what == "moving")
