#!/usr/bin/env python3
"""A volume in two views at once: the main one and an rviz/Camera's."""
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
    both: true
    Value: true
"""


class Views(unittest.TestCase):
    """Two views of one volume from opposite sides, the main one and a camera's: each sees what is near to it before what is behind."""

    def test_the_cameras_view_has_slices_of_its_own(self):
        view = {"Class": "rviz/TopDownOrtho", "Scale": 1200, "X": 0, "Y": 0, "Angle": 0, "Near Clip Distance": 0.01}
        text = rviz_stage.config(pictures.volume_display("both") + CAMERA, view, fixed_frame="stage")
        text = text.replace("  Hide Left Dock: true", "  Camera:\n    collapsed: false\n  Hide Left Dock: false")
        with rviz_stage.Stage(text, 1000, 640) as stage:
            rospy.init_node("rviz_views_test", disable_signals=True)
            voxels = numpy.full((20, 40, 40), pictures.HIGH, numpy.uint8)
            voxels[10:] = 180  # dim above, bright below
            topic = rospy.Publisher("both/volume", Volume, queue_size=1, latch=True)
            topic.publish(pictures.volume(voxels, [0.005] * 3, [-0.0975, -0.0975, -0.0475]))
            place = TransformStamped(child_frame_id="camera")
            place.header.frame_id = "stage"
            place.transform.translation.z, place.transform.rotation.w = -0.6, 1  # from below, along z
            tf2_ros.StaticTransformBroadcaster().sendTransform(place)
            images = rospy.Publisher("camera/image_raw", Image, queue_size=1)
            infos = rospy.Publisher("camera/camera_info", CameraInfo, queue_size=1)

            def check(picture):
                image = Image(width=320, height=240, encoding="rgb8", step=960, data=b"\0\0\x64" * 320 * 240)
                image.header.frame_id, image.header.stamp = "camera", rospy.Time.now()
                images.publish(image)
                infos.publish(CameraInfo(header=image.header, width=320, height=240, K=[300, 0, 160, 0, 300, 120, 0, 0, 1],
                                         R=[1, 0, 0, 0, 1, 0, 0, 0, 1], P=[300, 0, 160, 0, 0, 300, 120, 0, 0, 0, 1, 0], D=[0] * 5, distortion_model="plumb_bob"))
                left, right = picture[:, :320], picture[:, 330:]
                near = (left.min(axis=2) > 235).sum()
                self.assertGreater(near, 5000, "the camera sees the bright side")
                dim = abs(right[:, :, 0].astype(int) - (180 - pictures.LOW) * 255 // (pictures.HIGH - pictures.LOW)) < 12
                self.assertGreater(dim.sum(), 40000, "the main view sees the dim side")
            stage.agrees(check)


if __name__ == "__main__":
    absent = rviz_stage.missing()
    if absent:
        print("skipped: %s not found" % ", ".join(absent))
        sys.exit(rviz_stage.SKIPPED)
    import rospy
    import tf2_ros
    from geometry_msgs.msg import TransformStamped
    from pliant.msg import Volume
    from sensor_msgs.msg import CameraInfo, Image
    pictures.Volume = Volume
    unittest.main(warnings="ignore")  # rospy's own
