#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""image_folder_camera over ROS: a folder or a video played once or looped, and a folder that is watched."""
import math
import signal
import sys
import time

import cv2
import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from all_in_focus.camera.folder_node import MAX_UNPROCESSED
from camera_testing import CameraTest, places
from depth_testing import TIMEOUT, Talker, pixels_of, run_tests, wait_until
from file_helpers import SCRIPTS, SIZE, pictures, write_stack, write_video
from process_testing import Talkative

NODE = SCRIPTS / "image_folder_camera"

BUSY = """
import os, sys, threading, rospy
from all_in_focus.command_line import node, run

def body():
    lock = threading.Lock()  # as that of a connection: publish() and the shutdown both take it
    rospy.on_shutdown(lock.acquire)
    with lock:
        os.kill(os.getpid(), signal_number)
    rospy.spin()

signal_number = int(sys.argv.pop())
run(node("busy", "", body))
"""


class ImageFolderTest(CameraTest):
    def test_a_folder_once_with_focus_and_calibration(self):
        stack = write_stack(self.folder / "stack", ["0.png", "1.png", "2.png"])
        (self.folder / "focus.yaml").write_text(
            "frames: [{file: 0.png, focus_mm: 855.0}, {file: 2.png, focus_mm: .inf}]")
        node = self.start(NODE, stack=stack, focus=self.folder / "focus.yaml", rig=self.save_rig(SIZE), rate=50.0)
        # Before the first frame depth needs it.
        info = rospy.wait_for_message(self.topic("rgb/camera_info"), CameraInfo, TIMEOUT)
        self.assertEqual([info.width, info.K[0], info.header.frame_id], [SIZE[0], 60.0, "dslr"])
        time.sleep(1)  # nobody listens yet: nothing is lost
        self.listen_to_all()
        frames = self.frames(3)
        self.assertEqual(places(frames), [(0, 0, 3, False), (0, 1, 3, False), (0, 2, 3, True)])
        for (image, info, _), picture in zip(frames, pictures(3)):
            np.testing.assert_array_equal(pixels_of(image), picture)
            self.assertEqual([image.header.frame_id, info.K[0], info.width], ["dslr", 60.0, SIZE[0]])
        distances = [focus.focus_distance for _, _, focus in frames]
        self.assertEqual([distances[0], distances[2], math.isnan(distances[1])], [0.855, math.inf, True])
        self.assertTrue(node.said("all 3 frames are published"))
        time.sleep(0.3)
        self.assertEqual(len(self.heard["rgb/image"].messages), 3)

    def test_pictures_of_sixteen_bits(self):
        picture = pictures(1)[0].astype(np.uint16) * 256
        self.start(NODE, stack=write_stack(self.folder / "stack", ["0.png"], [picture]))
        self.listen_to_all()
        image = self.frames(1)[0][0]
        self.assertEqual(image.encoding, "bgr16")
        np.testing.assert_array_equal(np.frombuffer(image.data, np.uint16), picture.ravel())

    def test_a_video_looped_at_a_rate(self):
        video = write_video(self.folder / "sweep.avi", pictures(2))
        self.start(NODE, stack=video, rate=20.0, loop=True, width=24)
        self.listen_to_all()
        frames = self.frames(6)
        self.assertEqual(places(frames), [(bracket, index, 2, index == 1) for bracket in range(3) for index in (0, 1)])
        self.assertEqual([frames[0][0].width, frames[0][0].height], [24, 16])
        stamps = [image.header.stamp.to_sec() for image, _, _ in frames]
        self.assertGreaterEqual(stamps[-1] - stamps[0], 4 / 20)  # a frame that is late makes the one after it no later

    def test_frames_wait_for_what_is_said_to_come_first_then_for_the_fusion(self):
        stack = write_stack(self.folder / "stack", [f"{index:02d}.png" for index in range(MAX_UNPROCESSED + 2)])
        self.start(NODE, stack=stack, rate=100.0, wait_for="segmentation/processed", wait_timeout=60.0)
        processed = Talker(self.topic("all_in_focus/processed"), Header)
        regions = Talker(self.topic("segmentation/processed"), Header)
        self.listen_to_all()
        time.sleep(0.5)
        self.assertFalse(self.heard["rgb/image"].messages)
        regions.say(Header())
        frames = self.frames(MAX_UNPROCESSED)
        time.sleep(0.5)
        self.assertEqual(len(self.heard["rgb/image"].messages), MAX_UNPROCESSED)
        processed.say(frames[0][0].header)
        self.frames(MAX_UNPROCESSED + 1)
        # A fusion that does not answer is not waited for.
        self.assertTrue(wait_until(lambda: len(self.heard["rgb/image"].messages) == MAX_UNPROCESSED + 2))

    def test_a_signal_in_the_middle_of_a_message_ends_a_node(self):
        for number in (signal.SIGTERM, signal.SIGINT):
            node = Talkative([sys.executable, "-c", BUSY, str(int(number))])
            self.addCleanup(node.stop)
            self.assertEqual(node.process.wait(TIMEOUT), 0, node.lines)

    def test_a_watched_folder(self):
        write_stack(self.folder / "in", ["old.png"])
        (self.folder / "focus.yaml").write_text("frames: [{file: b.png, focus_mm: 900}]")
        node = self.start(NODE, stack=self.folder / "in", watch=True, bracket_gap=2.0, focus=self.folder / "focus.yaml")
        self.listen_to_all()
        self.assertTrue(node.said("watching"))
        first, second, third = pictures(3)
        cv2.imwrite(str(self.folder / "in" / "a.png"), first)
        data = cv2.imencode(".png", second)[1].tobytes()
        for end in (len(data) // 2, len(data)):  # a copy that takes its time
            (self.folder / "in" / "b.png").write_bytes(data[:end])
            time.sleep(0.3)
        self.frames(2)
        cv2.imwrite(str(self.folder / "in" / "a.png"), third)  # taken over
        frames = self.frames(3)
        self.assertEqual(places(frames), [(0, 0, 0, False), (0, 1, 2, True), (1, 0, 1, True)])
        for (image, _, _), picture in zip(frames, (first, second, third)):
            np.testing.assert_array_equal(pixels_of(image), picture)
        self.assertEqual(frames[1][2].focus_distance, 0.9)

    def test_wrong_parameters_end_in_one_line(self):
        write_stack(self.folder / "stack", ["0.png"])
        (self.folder / "stack.yaml").write_text("frames: [{file: x.png, focus_mm: 1}]")
        self.assert_all_refused(NODE, [
            ({}, "~stack is missing: give a folder of images or a video"),
            ({"stack": self.folder / "none", "watch": "true"}, "none: No such file or directory"),
            ({"stack": self.folder / "stack", "rate": 0}, "~rate: expected a number of at least"),
            ({"stack": self.folder / "stack", "focus": self.folder / "stack.yaml"}, "'x.png'")])


if __name__ == "__main__":
    run_tests(__file__)
