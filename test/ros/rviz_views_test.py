#!/usr/bin/env python3
"""Compare a marked scan with the ray caster, from every side and in two views at once: the main view and an
rviz/Camera."""
import os
import sys
import unittest

import numpy

import rviz_pictures_test as pictures
import rviz_stage

CAMERA = """
- Class: rviz/Camera
  Name: Camera
  Enabled: true
  Image Topic: camera/image_raw
  Image Rendering: background
  Overlay Alpha: 0.5
  Visibility:
    marked: true
    Value: true
"""
VOXEL, EDGE, RADIUS = 0.005, 48, 14  # [m], voxels, radius of the ball in the middle
BALL = 7  # labels: six marks, then the ball
# value and colour of each label
LOOKS = {7: (80, (0.75, 0.75, 0.75)), 1: (110, (1, 0, 0)), 2: (140, (0, 1, 0)), 3: (170, (0.1, 0.3, 1)),
         4: (200, (1, 1, 0)), 5: (225, (1, 0, 1)), 6: (250, (0, 1, 1))}
DISTANCE = 0.6  # distance of both cameras from the middle [m]


def marked_scan():
    """Return a ball with a cube on each side, each with a different value: labels[k, j, i]."""
    k, j, i = numpy.mgrid[0:EDGE, 0:EDGE, 0:EDGE] - (EDGE - 1) / 2
    labels = numpy.where(i * i + j * j + k * k < RADIUS ** 2, BALL, 0).astype(numpy.uint8)
    for side in range(6):
        away = [0.0, 0.0, 0.0]
        away[side // 2] = (RADIUS + 2) * (1 if side % 2 else -1)
        # different sizes, so that they can be distinguished
        labels[numpy.max(numpy.abs([i - away[0], j - away[1], k - away[2]]), axis=0) < 3 + side / 2] = side + 1
    return labels


def transfer():
    """Return a transfer function that is opaque within each label's band of values, and transparent in between."""
    points = []
    for value, (red, green, blue) in sorted(LOOKS.values()):
        for at, opacity in ((value - 8, 0), (value - 7, 0.15), (min(value + 7, 255), 0.15), (value + 8, 0)):
            if not points or at / 255 > points[-1][0]:
                points.append((at / 255, red, green, blue, opacity))
    return "; ".join("%.4f, %g, %g, %g, %g" % point for point in points if point[0] <= 1)


def matrix(rotation, translation):
    out = numpy.eye(4)
    out[:3, :3], out[:3, 3] = rotation, translation
    return out


def cast(labels, voxels, body, camera, size, focal, centre):
    """Return the labels that the ray caster sees. body, camera: their poses on the stage (4 x 4), with optical axes
    of the camera."""
    def volume_of(array):
        volume = library.Struct("pliant_volume")
        for name, value in (("geometry.size", array.shape[::-1]), ("geometry.spacing", [VOXEL] * 3),
                            ("geometry.direction", numpy.eye(3)),
                            ("geometry.origin", [-VOXEL * (EDGE - 1) / 2] * 3), ("encoding", 1), ("slope", 1),
                            ("voxels", array.ctypes.data)):
            volume[name] = value
        return volume
    seen = numpy.zeros(size[::-1], numpy.uint8)
    K = [[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]]
    at = pliant.camera_of(K, numpy.linalg.inv(body) @ camera, size, 0, 0)
    image, style = library.Struct("pliant_image"), library.Struct("pliant_style")
    scan, of = volume_of(voxels), volume_of(labels)
    library.call("style_defaults", scan.address, style.address)
    style["threshold"] = 76
    image["label"] = seen.ctypes.data
    library.call("render", scan.address, of.address, at.address, style.address, 2, image.address)
    return seen


def told_apart(picture, background):
    """Return the label of each pixel, by its hue."""
    colours = numpy.array([background] + [numpy.array(LOOKS[label][1]) * 255 for label in range(1, 8)])
    shown = picture.astype(float)
    return numpy.linalg.norm(shown[:, :, None] - colours, axis=3).argmin(axis=2)


def overlap(a, b):
    return (a & b).sum() / max((a | b).sum(), 1)


class Views(unittest.TestCase):
    def compare(self, picture, expected, background, voxel, where):
        """voxel: edge length of a voxel in the picture [pixels]. A border of this width contains mixed colours, so
        it is not compared."""
        seen = told_apart(picture, background)
        outlined = abs(picture.astype(int) - background).max(axis=2) > 40  # thin edges are faint
        self.assertGreater(overlap(outlined, expected > 0), 0.93, where + ": the outline")
        rim = int(numpy.ceil(voxel)) + 1
        inner = numpy.ones_like(expected, bool)
        for rows, columns in ((-rim, 0), (rim, 0), (0, -rim), (0, rim)):
            inner &= numpy.roll(expected, (rows, columns), (0, 1)) == expected
        for label in range(1, 8):
            of_it = inner & (expected == label)
            if of_it.sum() > 20:
                self.told.add(label)
                self.assertGreater((seen[of_it] == label).mean(), 0.7, "%s: mark %d is in front" % (where, label))

    def test_every_side_is_seen_as_the_ray_caster_sees_it(self):
        view = {"Class": "rviz/Orbit", "Distance": DISTANCE, "Pitch": 0, "Yaw": 0, "Near Clip Distance": 0.01}
        display = (pictures.volume_display("marked").replace("  Window: 127\n", "  Window: 255\n")
                   .replace("  Level: 191.5\n", "  Level: 127.5\n").replace(": 96\n", ": 192\n"))
        text = rviz_stage.config(display + '  Points: "%s"\n' % transfer() + CAMERA, view, fixed_frame="stage")
        text = text.replace("  Hide Left Dock: true", "  Camera:\n    collapsed: false\n  Hide Left Dock: false")
        with rviz_stage.Stage(text, 800, 420) as stage:
            rospy.init_node("rviz_views_test", disable_signals=True)
            labels = marked_scan()
            voxels = numpy.array([0] + [LOOKS[label][0] for label in range(1, 8)], numpy.uint8)[labels]
            topic = rospy.Publisher("marked/volume", Volume, queue_size=1, latch=True)
            topic.publish(pictures.volume(voxels, [VOXEL] * 3, [-VOXEL * (EDGE - 1) / 2] * 3, frame="body"))
            images = rospy.Publisher("camera/image_raw", Image, queue_size=1)
            infos = rospy.Publisher("camera/camera_info", CameraInfo, queue_size=1)
            # the main view stands on x and looks back, z up; the camera below looks up
            main = matrix(numpy.array([[0, 0, -1], [1, 0, 0], [0, -1, 0]]), [DISTANCE, 0, 0])
            below = matrix(numpy.eye(3), [0, 0, -DISTANCE])
            frames = tf2_ros.StaticTransformBroadcaster()

            def place(name, where, turn=(0, 0, 0, 1)):
                out = TransformStamped(child_frame_id=name)
                out.header.frame_id = "stage"
                out.transform.translation = Vector3(*where)
                out.transform.rotation = Quaternion(*turn)
                return out

            def send_image():
                image = Image(width=320, height=240, encoding="rgb8", step=960, data=b"\0\0\x64" * 320 * 240)
                image.header.frame_id, image.header.stamp = "camera", rospy.Time.now()
                images.publish(image)
                infos.publish(CameraInfo(header=image.header, width=320, height=240,
                                         K=[300, 0, 160, 0, 300, 120, 0, 0, 1], D=[0] * 5,
                                         R=[1, 0, 0, 0, 1, 0, 0, 0, 1], P=[300, 0, 160, 0, 0, 300, 120, 0, 0, 0, 1, 0],
                                         distortion_model="plumb_bob"))

            quarter = numpy.pi / 2
            turns = [([0, 0, 1], 0), ([0, 0, 1], quarter), ([0, 0, 1], 2 * quarter), ([0, 0, 1], -quarter),
                     ([0, 1, 0], quarter), ([0, 1, 0], -quarter),
                     ([1, 2, -0.7], 1.1)]
            self.told = set()
            for number, (axis, angle) in enumerate(turns):
                q = pictures.quaternion(axis, angle)
                body = matrix(pictures.rotation(q), [0, 0, 0])
                frames.sendTransform([place("body", [0, 0, 0], q), place("camera", [0, 0, -DISTANCE])])
                cached = {}

                def expected(camera, size, focal):
                    if size not in cached:
                        cached[size] = cast(labels, voxels, body, camera, size, focal,
                                            (size[0] / 2 - 0.5, size[1] / 2 - 0.5))
                    return cached[size]

                def check(picture):
                    send_image()
                    x, y, width, height = stage.window()
                    focal = 0.5 * height / numpy.tan(numpy.pi / 8)
                    wanted = expected(main, (width, height), focal)
                    self.compare(picture[y:y + height, x:x + width], wanted, (0, 0, 0), focal * VOXEL / DISTANCE,
                                 "main view, turn %d" % number)
                    dock = picture[:, :x]
                    blue = numpy.argwhere((abs(dock.astype(int) - [0, 0, 100]) < 12).all(axis=2))
                    self.assertGreater(len(blue), 2000, "the camera's image")
                    (top, left), (bottom, right) = blue.min(axis=0), blue.max(axis=0) + 1
                    scale = (right - left) / 320
                    wanted = expected(below, (int(right - left), int(bottom - top)), 300 * scale)
                    self.compare(dock[top:bottom, left:right], wanted, (0, 0, 100), 300 * scale * VOXEL / DISTANCE,
                                 "camera, turn %d" % number)
                stage.agrees(check, 30)
                if "PLIANT_TEST_PICTURE" in os.environ:
                    stage.picture("%s.%d.png" % (os.environ["PLIANT_TEST_PICTURE"], number))
            self.assertEqual(self.told, set(range(1, 8)), "each mark was in front once")


if __name__ == "__main__":
    absent = rviz_stage.missing()
    if absent:
        print("skipped: %s not found" % ", ".join(absent))
        sys.exit(rviz_stage.SKIPPED)
    import ctypes

    import pliant
    import pliant.pliant_library as library
    import rospy
    import tf2_ros
    from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
    from pliant.msg import Volume
    from sensor_msgs.msg import CameraInfo, Image
    library.declare(ctypes.c_int, "render", *[ctypes.c_void_p] * 4, ctypes.c_int, ctypes.c_void_p)
    pictures.Volume = Volume
    unittest.main(warnings="ignore")  # warnings of rospy
