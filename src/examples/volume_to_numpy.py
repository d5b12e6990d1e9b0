#!/usr/bin/env python3
"""How do I get the deformed scan of a running node as a numpy array?    volume_to_numpy.py [TOPIC] [PICTURE.pgm]

Subscribe to pliant/Volume (the whole volume, then boxes of changes), request the whole volume after a lost message, and
write the middle slice as a picture after every message."""
import sys

import numpy as np
import rospy
from pliant.msg import Volume
from std_msgs.msg import Empty

TYPES = {Volume.UINT8: np.uint8, Volume.INT16: "<i2", Volume.FLOAT32: "<f4"}
topic, picture = (sys.argv[1:] + ["volume", "middle_slice.pgm"][len(sys.argv) - 1:])[:2]
known = {}


def receive(message):
    if message.since == 0:  # a whole volume
        known.update(scan=message.scan_id, values=np.zeros(message.full_size[::-1], TYPES[message.encoding]))
    elif known.get("scan") != message.scan_id or message.since > known["sequence"]:
        resend.publish(Empty())  # a message was lost
        return
    known["sequence"] = message.sequence
    (i, j, k), (ni, nj, nk) = message.offset, message.size
    # order k, j, i; i is the fastest index
    box = np.frombuffer(message.data, TYPES[message.encoding]).reshape(nk, nj, ni)
    known["values"][k:k + nk, j:j + nj, i:i + ni] = box
    middle = known["values"][message.full_size[2] // 2] * message.slope + message.intercept
    grey = np.clip((middle + 200) / 500 * 255, 0, 255).astype(np.uint8)  # Hounsfield units from -200 to 300
    with open(picture, "wb") as file:
        file.write(b"P5 %d %d 255\n" % grey.shape[::-1] + grey.tobytes())
    rospy.loginfo("%s: %s voxels, box %s at %s, %.0f to %.0f", message.scan_id, message.full_size, message.size,
                  message.offset, middle.min(), middle.max())


rospy.init_node("volume_to_numpy", anonymous=True)
resend = rospy.Publisher(topic + "/resend", Empty, queue_size=1)
rospy.Subscriber(topic, Volume, receive, queue_size=10, buff_size=2 ** 26)
rospy.spin()
