#!/usr/bin/env python3
"""Make the README's picture launch/rviz/pulled.png: the phantom in rviz, cut by a frontal plane, while a tool pulls its
liver.

Needs the build's setup.bash. Runs under Xvfb with software rendering, for a minute.
"""
import os
import subprocess
import sys
import time

import numpy

import rviz_speed
from rviz_speed import rviz_stage

DISPLAYS = """
- Class: pliant/Volume
  Name: volume
  Enabled: true
  Topic: tissue/volume
  Preset: CT abdomen
  Slices: 640
  Slices While Moving: 64
  Color Bar: false
  Clip Plane:
    Value: true
    Normal: {X: 0, Y: 1, Z: 0}
    Point: {X: 0, Y: -0.04, Z: 0}
- Class: rviz/MarkerArray
  Enabled: true
  Marker Topic: tissue/grasper/marker
  Name: tool and its force
"""
VIEW = {"Class": "rviz/Orbit", "Distance": 0.52, "Yaw": 4.85, "Pitch": 0.25, "Near Clip Distance": 0.01,
        "Focal Point": "{X: 0, Y: 0, Z: -0.005}"}
SIZE = 640, 500
# grasped point at the lower edge of the liver behind the cut, and its displacement towards the pelvis [m]
HOLD, WAY = numpy.array([-0.085, -0.035, 0.046]), numpy.array([0.035, 0.0, -0.06])
PARAMETERS = ["_tools:=grasper", "_tool_max_age:=1.0", "_mesh/coarse_cells:=[14, 10, 11]", "_grasp/stiffness:=3000.0"]
FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "launch", "rviz")


def wait_until_still(stage, hold):
    """Wait until the picture stays the same for eight seconds, which is longer than a frame with all slices. hold():
    keeps the tool's pose."""
    last, since = stage.picture(), time.time()
    while time.time() < since + 8:
        hold()
        time.sleep(0.02)
        now = stage.picture()
        if (now != last).any():
            since = time.time()
        last = now


def save(stage, name):
    x, y, width, height = stage.window()
    path = os.path.join(FOLDER, name + ".png")
    stage.picture(path)
    subprocess.run(["convert", path, "-crop", "%dx%d+%d+%d" % (width, height, x, y), "+repage", "-strip", "-dither",
                    "None",
                    "-colors", "256", "png8:" + path], check=True)
    print(path, os.path.getsize(path), "bytes")


def main():
    width, height = SIZE[0] + rviz_speed.BESIDE, SIZE[1] + rviz_speed.ABOVE
    configuration = rviz_stage.config(DISPLAYS, VIEW, background="24; 24; 28")
    with rviz_stage.Stage(configuration, width, height) as stage:
        stage.start([rviz_stage.program("pliant_node"), "__ns:=tissue", "_scene:=" + rviz_speed.SCENE] + PARAMETERS,
                    "node")
        stage.mouse("mousemove", 0, 0)
        stage.wait_for(lambda p: (p[rviz_speed.ABOVE:-30, 50:-50].max(axis=2) > 60).mean() > 0.1, 120, "the phantom")
        wait_until_still(stage, lambda: None)
        tool = rviz_speed.Tool(HOLD)
        stage.wait(tool.grasp, 60, "the grasp")
        start = time.time()
        while time.time() < start + 4:
            tool.send(HOLD + WAY * min(1, (time.time() - start) / 3))
            time.sleep(0.02)
        wait_until_still(stage, lambda: tool.send(HOLD + WAY))
        save(stage, "pulled")


if __name__ == "__main__":
    sys.exit(main())
