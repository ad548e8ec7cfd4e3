# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shared by the tests of the camera nodes: starts nodes as processes, and listens to their three topics."""
import tempfile
import unittest
from pathlib import Path

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image

from all_in_focus.msg import FocusFrame
from all_in_focus.files.rig import Camera, Rig, save_rig
from depth_testing import TIMEOUT, Listener, wait_until
from file_helpers import Fork
from process_testing import Talkative

HERE = Path(__file__).resolve().parent
TOPICS = {"rgb/image": Image, "rgb/camera_info": CameraInfo, "rgb/focus": FocusFrame}


class NodeProcess(Talkative):
    started = Fork

    def __init__(self, path, namespace, **parameters):
        arguments = [f"_{name}:={value}" for name, value in parameters.items()]
        super().__init__([path, "__ns:=" + namespace, *arguments], ROSCONSOLE_FORMAT="${message}")

    def exit_code(self):
        return self.process.wait(timeout=TIMEOUT)


class CameraTest(unittest.TestCase):
    """Stops its nodes at the end; each test has its own namespace and folder."""

    def setUp(self):
        self.namespace = "/" + self.id().split(".")[-1]
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def start(self, path, **parameters):
        if rospy.has_param(self.namespace):
            rospy.delete_param(self.namespace)  # of the node before
        node = NodeProcess(path, self.namespace, **parameters)
        self.addCleanup(node.stop)
        return node

    def assert_all_refused(self, path, cases):
        """cases: parameters, words. With these parameters the node ends with exit code 2 and one line, which holds the words."""
        nodes = [NodeProcess(path, f"{self.namespace}/case_{number}", **parameters)
                 for number, (parameters, _) in enumerate(cases)]
        for node in nodes:
            self.addCleanup(node.stop)
        for node, (_, words) in zip(nodes, cases):
            with self.subTest(words):
                self.assertEqual(node.exit_code(), 2)
                self.assertTrue(node.said(words), node.lines)
                self.assertEqual(len([line for line in node.lines if line.strip()]), 1, node.lines)

    def topic(self, name):
        return self.namespace + "/" + name

    def listen(self, name, kind):
        listener = Listener(self.topic(name), kind)
        self.addCleanup(listener.close)
        return listener

    def listen_to_all(self):
        """Call before anything is published."""
        self.heard = {name: self.listen(name, kind) for name, kind in TOPICS.items()}

    def of_frames(self, name):
        """The newest message of a topic for each image: camera_info is also published before the first frame, and focus
        may be corrected before the image comes."""
        newest = {message.header.stamp: message for message in list(self.heard[name].messages)}
        images = [image.header.stamp for image in list(self.heard["rgb/image"].messages)]
        return [newest[stamp] for stamp in images if stamp in newest]

    def frames(self, count, timeout=TIMEOUT):
        """The first `count` frames, as (image, camera_info, focus) of one stamp and frame_id each."""
        self.assertTrue(wait_until(lambda: all(len(self.of_frames(name)) >= count for name in TOPICS), timeout),
                        {name: len(self.of_frames(name)) for name in TOPICS})
        frames = list(zip(*(self.of_frames(name)[:count] for name in TOPICS)))
        for messages in frames:
            self.assertEqual(len({message.header.stamp for message in messages}), 1)
            self.assertEqual(len({message.header.frame_id for message in messages}), 1)
        return frames

    def save_rig(self, size, frame="dslr"):
        """A rig folder for pictures of this size."""
        camera = Camera.pinhole("camera", *size, 60.0, 60.0, size[0] / 2, size[1] / 2)
        save_rig(str(self.folder / "rig"), Rig(camera, camera, np.eye(3), [0.0, 0.0, 0.0], None, frame, "kinect"))
        return self.folder / "rig"


def places(frames):
    """What the FocusFrames say: (bracket_id, index, count, last)."""
    return [(focus.bracket_id, focus.index, focus.count, focus.last) for _, _, focus in frames]
