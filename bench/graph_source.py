#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A depth and a colour camera, as bench/graph_rate needs them: images come at a steady rate, stamped with the time
at which they are sent. Prints, as JSON, how many it sent and how long it took.

Every colour frame has a depth image of the same stamp, so that all nodes work at the full rate.
"""
import argparse
import json
import os
import re
import time
import warnings

import cv2
import cv_bridge
import numpy as np
import rospy
import tf2_ros
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from all_in_focus.files.rig_messages import camera_info, static_transform
from all_in_focus.command_line import Parser, count, positive, run
from all_in_focus.msg import FocusFrame
from all_in_focus.files.rig import load_rig
from all_in_focus.files.stack import read_depth

# Without a queue: an image is sent, or waits, when it is published, and none is lost on this side.
warnings.filterwarnings("ignore", message=".*queue_size", category=SyntaxWarning)

DIFFERENT = 4  # images of each kind, sent in turn


def size_of(text):
    """argparse type: WxH."""
    match = re.fullmatch(r"(\d{2,4})x(\d{2,4})", text)
    if not match:
        raise argparse.ArgumentTypeError(f"'{text}': expected WIDTHxHEIGHT")
    return int(match[1]), int(match[2])


def add_options(parser):
    """What the images are like."""
    parser.add_argument("--rig", required=True, help="rig folder")
    parser.add_argument("--depth", required=True, help="depth image of its depth camera, 16-bit PNG, mm")
    parser.add_argument("--size", type=size_of, metavar="WxH", help="scale depth, colour and their cameras to that size")
    parser.add_argument("--noise", type=float, default=0.0, metavar="MM", help="add so much to every known depth")
    parser.add_argument("--rate", type=positive, default=30.0, help="Hz, default %(default)s")
    parser.add_argument("--frames", type=count, default=300, help="default %(default)s")
    parser.add_argument("--bracket", type=count, default=10, help="frames in a bracket, default %(default)s")
    parser.add_argument("--depth-only", action="store_true", help="no colour images: registration and segmentation alone")


def depth_images(args):
    """With new noise in each, which leaves all known pixels known."""
    depth = read_depth(args.depth)
    if args.size:
        depth = cv2.resize(depth, args.size, interpolation=cv2.INTER_NEAREST)
    random = np.random.default_rng(0)
    for _ in range(DIFFERENT if args.noise else 1):
        noisy = np.rint(depth + random.normal(0, args.noise, depth.shape))
        yield np.where(depth > 0, np.clip(noisy, 1, 65535), 0).astype(np.uint16)


def color_images(camera):
    """Frames of a sweep: one texture, each time more blurred and a little larger."""
    random = np.random.default_rng(0)
    size = (camera.width, camera.height)
    coarse = random.integers(0, 256, (camera.height // 8, camera.width // 8, 3), np.uint8)
    sharp = cv2.addWeighted(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC), 0.7,
                            random.integers(0, 256, (camera.height, camera.width, 3), np.uint8), 0.3, 0)
    for i in range(DIFFERENT):
        larger = cv2.getRotationMatrix2D((camera.width / 2, camera.height / 2), 0, 1 + 0.003 * i)
        yield cv2.warpAffine(cv2.GaussianBlur(sharp, (0, 0), 0.7 + 0.4 * i), larger, size, borderMode=cv2.BORDER_REFLECT)


class Source:
    """Publishers and their messages, made in advance: sending must not take long."""

    def __init__(self, args):
        self.args, self.rig, bridge = args, load_rig(args.rig), cv_bridge.CvBridge()
        if args.size:
            self.rig.color, self.rig.depth = (camera.scaled(*args.size) for camera in (self.rig.color, self.rig.depth))
        self.depth = [bridge.cv2_to_imgmsg(image, "16UC1") for image in depth_images(args)]
        self.color = [] if args.depth_only else [bridge.cv2_to_imgmsg(image, "bgr8") for image in color_images(self.rig.color)]
        self.infos = {"/rgb/camera_info": self.rig.color, "/depth/camera_info": self.rig.depth}
        self.publishers = {topic: rospy.Publisher(topic, kind, queue_size=None) for topic, kind in (
            ("/rgb/camera_info", CameraInfo), ("/depth/camera_info", CameraInfo), ("/depth/image_raw", Image),
            ("/rgb/focus", FocusFrame), ("/rgb/image", Image))}
        self.transform = tf2_ros.StaticTransformBroadcaster()
        self.transform.sendTransform(static_transform(self.rig, rospy.Time.now()))

    def send(self, i):
        stamp, bracket = rospy.Time.now(), self.args.bracket
        color = Header(stamp=stamp, frame_id=self.rig.parent_frame)
        depth = Header(stamp=stamp, frame_id=self.rig.child_frame)
        for topic, camera in self.infos.items():
            self.publishers[topic].publish(camera_info(camera, color if camera is self.rig.color else depth))
        self.publish("/depth/image_raw", self.depth[i % len(self.depth)], depth)
        if self.color:
            index = i % bracket
            self.publishers["/rgb/focus"].publish(FocusFrame(color, i // bracket, index, bracket, index + 1 == bracket,
                                                             1 + 0.2 * index))
            self.publish("/rgb/image", self.color[i % len(self.color)], color)

    def publish(self, topic, message, header):
        message.header = header
        self.publishers[topic].publish(message)

    def run(self):
        """Seconds that all frames took, each with the pause after it."""
        begin = time.monotonic()
        for i in range(self.args.frames):
            time.sleep(max(0, begin + i / self.args.rate - time.monotonic()))
            self.send(i)
        time.sleep(max(0, begin + self.args.frames / self.args.rate - time.monotonic()))
        return time.monotonic() - begin


def main():
    parser = Parser(prog="graph_source.py", description=__doc__)
    add_options(parser)
    args = parser.parse_args()
    rospy.init_node("graph_source", disable_signals=True)
    source = Source(args)
    deadline = time.monotonic() + 20
    wanted = ["/depth/image_raw", "/depth/camera_info", "/rgb/camera_info"] + ["/rgb/image"] * (not args.depth_only)
    while any(source.publishers[topic].get_num_connections() == 0 for topic in wanted):
        if time.monotonic() > deadline:
            parser.error("nobody listens")
        time.sleep(0.1)
    time.sleep(1)
    print(json.dumps({"sent": args.frames, "seconds": source.run()}), flush=True)
    time.sleep(1)
    os._exit(0)  # rospy's threads may take long


if __name__ == "__main__":
    run(main)
