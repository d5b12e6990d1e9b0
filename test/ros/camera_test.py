#!/usr/bin/env python3
"""Test cameras over topics: pictures, depth, tissues, points and calibration. A tool pulls the visible tissue.
Without subscribers, nothing is rendered."""
import os
import sys
import unittest

import numpy
import rospy
import rostest
import tf2_ros
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from pliant.msg import ContactState, ScanInfo
from pliant.srv import Pick
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from node_client import Latest, Tool, call, is_sent, wait_for  # noqa: E402

POINT = numpy.array([-0.06, -0.06, 0.07])  # in the phantom's liver [m, tissue frame]
AWAY = 0.3  # distance of the cameras in front of it [m]
HALF = numpy.sqrt(0.5)


def transform(child, translation, rotation):
    out = TransformStamped()
    out.header.stamp, out.header.frame_id, out.child_frame_id = rospy.Time.now(), "tissue", child
    out.transform.translation.x, out.transform.translation.y, out.transform.translation.z = translation
    out.transform.rotation.x, out.transform.rotation.y, out.transform.rotation.z, out.transform.rotation.w = rotation
    return out


def pixels_of(message):
    types = {"rgb8": (numpy.uint8, 3), "32FC1": (numpy.float32, 1), "8UC1": (numpy.uint8, 1)}
    dtype, channels = types[message.encoding]
    shape = (message.height, message.width, channels) if channels > 1 else (message.height, message.width)
    assert message.step == message.width * channels * numpy.dtype(dtype).itemsize
    return numpy.frombuffer(message.data, dtype).reshape(shape)


def points_of(message):
    """Return the points (height, width, 3) and the colours (height, width, 3)."""
    raw = numpy.frombuffer(message.data, numpy.float32).reshape(message.height, message.width, 4)
    colours = raw[..., 3].copy().view(numpy.uint32)
    return raw[..., :3], numpy.stack([colours >> shift & 255 for shift in (16, 8, 0)], axis=-1)


def picked(origin, direction, threshold):
    """Return the node's pick result of a ray in the tissue's frame."""
    ask = Pick._request_class(threshold=threshold)
    ask.header.frame_id = "tissue"
    ask.origin.x, ask.origin.y, ask.origin.z = origin
    ask.direction.x, ask.direction.y, ask.direction.z = direction
    answer = call("pick", Pick, *[getattr(ask, name) for name in ask.__slots__])
    assert answer.success, answer.message
    return answer


class CameraTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("camera_test")
        cls.frames = tf2_ros.StaticTransformBroadcaster()
        place = POINT + [0, -AWAY, 0]
        # optical: x to the patient's left, y to the feet, z to the back: a quarter turn about x; AMBF: x to the front,
        # y left, z to the head
        cls.frames.sendTransform([transform("front_optical", place, (-HALF, 0, 0, HALF)),
                                  transform("scope", place, (0, 0, -HALF, HALF))])
        cls.pictures = []
        cls.diagnostics = rospy.Subscriber("/diagnostics", DiagnosticArray, cls.count)
        cls.tool = Tool("grasper", "tissue")
        info = Latest("scan_info", ScanInfo)
        cls.names = wait_for(lambda: info.message, "the scan", 120).material_names

    @classmethod
    def count(cls, message):
        for status in message.status:
            for pair in status.values:
                if pair.key == "pictures":
                    cls.pictures.append((message.header.stamp, int(pair.value)))

    def pictures_since(self, start):
        """Wait for diagnostics with this time stamp or a later one. Return the number of pictures that they report."""
        wait_for(lambda: self.pictures and self.pictures[-1][0] >= start, "diagnostics")
        return self.pictures[-1][1]

    def tearDown(self):
        self.tool.reset()

    def test_calibration_is_there_before_any_picture(self):
        mono, right = Latest("front/camera_info", CameraInfo), Latest("scope/right/camera_info", CameraInfo)
        info = wait_for(lambda: mono.message, "a calibration")
        other = wait_for(lambda: right.message, "another one")
        focal = 80 / numpy.tan(numpy.radians(30))
        numpy.testing.assert_allclose(info.K, [focal, 0, 79.5, 0, focal, 59.5, 0, 0, 1], rtol=1e-9)
        self.assertEqual((info.width, info.height, info.header.frame_id), (160, 120, "front_optical"))
        self.assertEqual(list(info.D), [0] * 5)
        self.assertAlmostEqual(other.P[3], -0.012 * other.P[0])
        mono.close(), right.close()

    def test_nobody_looks_and_nothing_is_drawn(self):
        looks = Latest("front/image_raw", Image)
        wait_for(lambda: looks.message, "a picture")
        looks.close()
        wait_for(lambda: not is_sent("sim", "front/image_raw", rospy.get_name()), "the node to see that nobody looks")
        before = self.pictures_since(rospy.Time.now())
        self.assertGreater(before, 0)
        # one picture may have been pending; in two seconds, a camera that draws makes 20
        self.assertLessEqual(self.pictures_since(rospy.Time.now() + rospy.Duration(2)) - before, 1)

    def test_the_side_that_a_tool_pulls_comes_nearer(self):
        image, depth, label, points = (Latest("front/" + topic, kind) for topic, kind in (
            ("image_raw", Image), ("depth/image_rect", Image), ("label/image_raw", Image), ("points", PointCloud2)))
        self.assertEqual(self.names[picked(POINT, (0, -1, 0), -1e9).material], "organ")
        before = pixels_of(wait_for(lambda: depth.message, "depth"))
        picture, tissue = (pixels_of(wait_for(lambda: image.message, "a picture")),
                           pixels_of(wait_for(lambda: label.message, "labels")))
        self.assertEqual(image.message.header.frame_id, "front_optical")
        middle = before[60, 80]
        self.assertTrue(0.1 < middle < AWAY)  # the abdominal wall lies in front of the liver
        self.assertGreater(picture[60, 80].max(), 60)
        there = picked(POINT + [0, -AWAY, 0], (0.5 / 138.56, 1, -0.5 / 138.56), -300)
        self.assertEqual(self.names[tissue[60, 80] - 1], self.names[there.material])
        self.assertAlmostEqual(middle, there.distance, delta=1e-3)
        self.assertTrue(((tissue > 0) == numpy.isfinite(before)).mean() > 0.98)
        place, colours = points_of(wait_for(lambda: points.message, "points"))
        numpy.testing.assert_allclose(place[60, 80], [0.5 / 138.56 * place[60, 80, 2], 0.5 / 138.56 * place[60, 80, 2],
                                                      place[60, 80, 2]], atol=1e-4)
        self.assertAlmostEqual(place[60, 80, 2], middle, delta=1e-3)
        self.assertTrue((colours[60, 80] == picture[60, 80]).all())

        wall = POINT + [0, middle - AWAY + 0.006, 0]  # slightly below the skin
        contact = Latest("grasper/contact", ContactState)
        self.tool.appear(wall)
        self.tool.take_hold(contact)
        self.tool.position = list(wall - [0, 0.02, 0])
        nearer = wait_for(lambda: (lambda now: now if before[60, 80] - now[60, 80] > 0.008
                                   else None)(pixels_of(depth.message)), "the wall to come nearer")
        moved = numpy.where(numpy.isfinite(before) & numpy.isfinite(nearer), before - nearer, 0)
        self.assertLess(moved[60, 80], 0.03)
        # at the point, and not at the side
        self.assertGreater(moved[50:70, 70:90].mean(), 3 * abs(moved[:, :20]).mean())
        for latest in (image, depth, label, points, contact):
            latest.close()

    def test_two_eyes_see_bone_through_the_wall(self):
        left, right, cloud = (Latest("scope/left/depth/image_rect", Image),
                              Latest("scope/right/depth/image_rect", Image), Latest("scope/left/points", PointCloud2))
        a, b = (pixels_of(wait_for(lambda: left.message, "a left eye")),
                pixels_of(wait_for(lambda: right.message, "a right eye")))
        self.assertGreater(numpy.isfinite(a).mean(), 0.02)
        self.assertGreater(numpy.nanmin(a), 0.15)
        self.assertTrue((numpy.nan_to_num(a) != numpy.nan_to_num(b)).any())
        place, _ = points_of(wait_for(lambda: cloud.message, "points"))
        seen = numpy.isfinite(place[..., 0])
        self.assertLess(place[..., 0][seen].max(), -0.15)  # AMBF's x axis points backwards
        row, column = numpy.argwhere(seen)[0]
        z = -place[row, column, 0]
        focal = 40 / numpy.tan(numpy.radians(25))
        numpy.testing.assert_allclose(place[row, column, 1:], [(column - 39.5) / focal * z, -(row - 29.5) / focal * z],
                                      atol=1e-5)
        for latest in (left, right, cloud):
            latest.close()

    def test_disparity_of_two_eyes_is_what_depth_and_calibration_tell(self):
        stamps = {"left": [], "right": []}
        watched = [rospy.Subscriber("/tissue/scope/%s/image_raw" % side, Image,
                                    lambda message, side=side: stamps[side].append(message.header.stamp))
                   for side in stamps]
        pictures = [Latest("scope/%s/image_raw" % side, Image) for side in ("left", "right")]
        depths, info = ([Latest("scope/%s/depth/image_rect" % side, Image) for side in ("left", "right")],
                        Latest("scope/right/camera_info", CameraInfo))
        for latest in pictures + depths + [info]:
            self.addCleanup(latest.close)
        for each in watched:
            self.addCleanup(each.unregister)
        left, right = (pixels_of(wait_for(lambda: picture.message, "a picture")).mean(axis=2) for picture in pictures)
        z, other = (pixels_of(wait_for(lambda: depth.message, "depth")) for depth in depths)
        P = wait_for(lambda: info.message, "a calibration").P
        columns, disparity = numpy.arange(80), -P[3] / z  # [pixels]: focal length times baseline divided by depth

        # the right eye's values where a fraction of the disparity moves the left eye's pixels
        def seen_right(of, part):
            at = columns - part * disparity
            there = numpy.isfinite(at) & (at >= 0) & (at <= 79)
            return there, numpy.array([numpy.interp(numpy.nan_to_num(row), columns, line) for row, line in zip(at, of)])
        parts, apart = numpy.linspace(0, 2, 41), []
        for part in parts:
            there, picture = seen_right(right, part)
            apart.append(numpy.abs(picture - left)[there].mean())
        self.assertGreater(numpy.nanmedian(disparity), 2)
        self.assertAlmostEqual(parts[numpy.argmin(apart)], 1, delta=0.101)
        self.assertLess(min(apart), 0.5 * apart[0])
        there, depth = seen_right(other, 1)  # NaN next to invisible pixels
        apart = numpy.abs(depth - z)[there & numpy.isfinite(depth)]
        self.assertGreater(len(apart), 100)
        self.assertLess(numpy.median(apart), 0.002)  # both eyes see a point at the same z

        def come_in_pairs():  # stereo matching needs pairs; a queue of one may lose some, more on a busy machine
            eyes = [list(each) for each in stamps.values()]
            last = min(each[-1] for each in eyes)
            latest = [set([stamp for stamp in each if stamp <= last][-20:]) for each in eyes]
            return len(latest[0] & latest[1]) >= 18
        wait_for(come_in_pairs, "the same stamps of both eyes, 18 of the last 20")


if __name__ == "__main__":
    rostest.rosrun("pliant", "camera", CameraTest)
