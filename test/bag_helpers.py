# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A small bag that can be fused, message by message, to be damaged by tests."""
import io

import cv2
import genpy
import numpy as np
import rosbag
from cv_bridge import CvBridge
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from all_in_focus.image_messages import to_message
from all_in_focus.files.rig_messages import camera_info
from all_in_focus.imaging import linear_to_srgb
from all_in_focus.msg import FocusFrame, Optics as OpticsMessage
from all_in_focus.files.rig import Camera

SIZE = (64, 48)
DIOPTRES = (1.0, 0.8, 0.65, 0.5)  # 1/m; the lens covers 0.13 to either side
NEAR, FAR = 1000, 2000  # mm; left half, right half
DEPTH_CAMERA = Camera.pinhole("depth", *SIZE, 56.0, 56.0, 31.5, 23.5)
COLOR_CAMERA = Camera.pinhole("color", *SIZE, 60.0, 60.0, 31.5, 23.5)
BRIDGE = CvBridge()
START = 10000.0  # s


def frames():
    """Every half is sharp where the lens is focused on it; blurred in linear light, so that its mean stays."""
    light = np.random.default_rng(1).uniform(0.05, 0.6, (SIZE[1], SIZE[0], 3)).astype(np.float32)
    made = []
    for focus in DIOPTRES:
        halves = [cv2.GaussianBlur(light, (0, 0), 0.2 + 2 * abs(focus - 1000.0 / depth)) for depth in (NEAR, FAR)]
        left = np.arange(SIZE[0])[None, :, None] < SIZE[0] // 2
        made.append(np.rint(linear_to_srgb(np.where(left, *halves))).astype(np.uint8))
    return made


def depth_image():
    return np.tile(np.where(np.arange(SIZE[0]) < SIZE[0] // 2, NEAR, FAR).astype(np.uint16), (SIZE[1], 1))


def good_messages(brackets=1):
    """List of [topic, message, seconds]; brackets follow each other by 10 s, each with its depth image."""
    transform = TransformStamped(header=Header(frame_id="color"), child_frame_id="depth")
    transform.transform.translation, transform.transform.rotation = Vector3(0.03, 0, 0), Quaternion(0, 0, 0, 1)
    messages = [["/tf_static", TFMessage([transform]), START], ["/rgb/optics", OpticsMessage(24.0, 4.0, 0.019), START]]
    for number in range(brackets):
        begin = START + 10 * number
        header = Header(stamp=genpy.Time.from_sec(begin), frame_id="depth")
        messages += [["/depth/camera_info", camera_info(DEPTH_CAMERA, header), begin],
                     ["/depth/image_raw", to_message(depth_image(), "16UC1", header), begin]]
        for index, picture in enumerate(frames()):
            when = begin + 0.1 * index
            header = Header(stamp=genpy.Time.from_sec(when), frame_id="color")
            focus = FocusFrame(header=header, bracket_id=number, index=index, count=len(DIOPTRES),
                               last=index + 1 == len(DIOPTRES), focus_distance=1 / DIOPTRES[index])
            messages += [["/rgb/camera_info", camera_info(COLOR_CAMERA, header), when], ["/rgb/focus", focus, when],
                         ["/rgb/image", to_message(picture, "bgr8", header), when]]
    # As after reading: messages shared their headers.
    return [[topic, copied(message), when] for topic, message, when in messages]


def copied(message):
    buffer = io.BytesIO()
    message.serialize(buffer)
    return type(message)().deserialize(buffer.getvalue())


def write(path, messages, compression="none"):
    with rosbag.Bag(str(path), "w", compression=compression) as bag:
        for topic, message, when in messages:
            bag.write(topic, message, genpy.Time.from_sec(when))
    return str(path)


def rewritten(source, target, change):
    """Copy of a bag. change(topic, message): may alter the message; returns False to leave it out, another (topic, message) to
    write instead, or anything else."""
    with rosbag.Bag(str(source)) as old, rosbag.Bag(str(target), "w") as new:
        for topic, message, when in old.read_messages():
            changed = change(topic, message)
            if changed is not False:
                new.write(*(changed if isinstance(changed, tuple) else (topic, message)), when)
    return target


# --- damages: functions that take the list of messages, and change it or return a new one ----------------------------

def changed(prefix, change):
    """change(message, number) alters each message with a header of topics that begin so, or returns another."""
    def damage(messages):
        number = 0
        for entry in messages:
            if entry[0].startswith(prefix) and (hasattr(entry[1], "header") or entry[0] == prefix):
                entry[1] = change(entry[1], number) or entry[1]
                number += 1
        return messages
    return damage


def setting(topic, **fields):
    def change(message, _):
        for name, value in fields.items():
            setattr(message, name, value)
    return changed(topic, change)


def without(topic):
    return lambda messages: [entry for entry in messages if entry[0] != topic]


def compressed(message, _):
    """The image as CompressedImage."""
    image = BRIDGE.cv2_to_compressed_imgmsg(BRIDGE.imgmsg_to_cv2(message), "png")
    image.header = message.header
    return image
