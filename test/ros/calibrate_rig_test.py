#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_rig --live and check_rig --live: rendered boards and scenes on the cameras' topics."""
import subprocess
import sys

import cv2
import cv_bridge
import numpy as np
import rospy
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from all_in_focus.files.rig import load_rig
from camera_testing import CameraTest
from depth_testing import run_tests, wait_until
from board_rendering import board_poses, in_color_camera, mapping_error, rays, render, true_rig
from file_helpers import SCRIPTS, start

PATIENCE = 300  # s


class CalibrateRigTest(CameraTest):
    def setUp(self):
        super().setUp()
        self.bridge = cv_bridge.CvBridge()

    def program(self, name, *options):
        """A script whose relative topics are in this test's namespace."""
        program = start([sys.executable, SCRIPTS / name, *options, "__ns:=" + self.namespace], stderr=subprocess.STDOUT)
        self.addCleanup(program.stdout.close)
        self.addCleanup(program.wait)
        self.addCleanup(program.kill)
        return program

    def publisher(self, topic):
        publisher = rospy.Publisher(self.topic(topic), Image, queue_size=5)
        self.addCleanup(publisher.unregister)
        return publisher

    def publish(self, publishers, messages):
        stamp = rospy.Time.now()
        for publisher, message in zip(publishers, messages):
            message.header.stamp = stamp
            publisher.publish(message)

    def live(self, *options):
        """calibrate_rig, listening; also sets self.publishers and self.coverage."""
        program = self.program("calibrate_rig", "--live", "--board", "8x6", "--square", "45", "--output",
                               self.folder / "rig", *options)
        self.publishers = [self.publisher(topic) for topic in ("ir/image", "rgb/image")]
        self.coverage = self.listen("calibrate_rig/coverage", Image)
        connected = [publisher.get_num_connections for publisher in self.publishers]
        connected.append(self.coverage.subscriber.get_num_connections)
        self.assertTrue(wait_until(lambda: all(count() for count in connected), PATIENCE))
        return program

    def show(self, pictures):
        """Publish a pair, again until the answer comes: the picture of the coverage."""
        known = len(self.coverage.messages)
        messages = [self.bridge.cv2_to_imgmsg(picture, encoding)
                    for picture, encoding in zip(pictures, ("mono16", "bgr8"))]
        for _ in range(5):
            self.publish(self.publishers, messages)
            if wait_until(lambda: len(self.coverage.messages) > known, PATIENCE / 4):
                return self.coverage.messages[-1]
        self.fail("no picture of the coverage")

    def test_boards_shown_to_both_cameras_become_a_rig(self):
        truth = true_rig()
        camera_rays = rays(truth.depth), rays(truth.color)
        program = self.live("--save-pictures", self.folder / "pictures", "--views", 10)
        rig_folder = self.folder / "rig"
        rig_folder.write_text("in the way")  # no view is lost by it
        finish = rospy.ServiceProxy(self.topic("calibrate_rig/finish"), Trigger)
        finish.wait_for_service(PATIENCE)
        self.assertIn("no pair is taken yet", finish().message)
        for number, pose in enumerate(board_poses(truth, 12, near=0.47)):
            ir = render(camera_rays[0], pose, 40, 110, 60, blur=1.0, seed=number, scale=8)
            color = render(camera_rays[1], in_color_camera(truth, pose), seed=100 + number)
            color = cv2.cvtColor(color, cv2.COLOR_GRAY2BGR)
            for _ in range(2):  # the first time it has moved
                picture = self.show((ir, color))
        self.assertEqual(picture.encoding, "rgb8")
        self.assertIn("rig: is no folder", finish().message)
        rig_folder.unlink()
        answer = finish()
        self.assertTrue(answer.success, answer.message)
        self.assertIn("wrote", answer.message)
        said, _ = program.communicate(timeout=PATIENCE)
        self.assertEqual(program.returncode, 0, said)
        self.assertIn("rig: is no folder; taking more pairs", said)  # enough: it has tried by itself
        rig = load_rig(str(rig_folder))
        self.assertLess(mapping_error(rig, truth).max(), 0.3)  # 0.07 px
        self.assertLess(np.linalg.norm(rig.t - truth.t), 0.002)  # 0.06 mm
        self.assertGreaterEqual(len(list((self.folder / "pictures" / "depth").iterdir())), 10)

    def test_what_ends_early_writes_nothing(self):
        program = self.live()
        damaged = Image(height=480, width=640, encoding="mono16", step=1280, data=b"short")
        self.publish(self.publishers, [damaged, damaged])
        self.show((np.full((120, 160), 500, np.uint16), np.zeros((120, 160, 3), np.uint8)))
        finish = rospy.ServiceProxy(self.topic("calibrate_rig/finish"), Trigger)
        self.assertFalse(finish().success)
        program.send_signal(2)
        said, _ = program.communicate(timeout=PATIENCE)
        self.assertEqual(program.returncode, 130, said)
        self.assertFalse(list(self.folder.iterdir()))

    def test_check_rig_takes_the_newest_images(self):
        program = self.program("check_rig", "--live", "--timeout", PATIENCE, "--output", self.folder / "o.png")
        depth = np.full((240, 320), 3000, np.uint16)
        color = np.full((240, 320, 3), 200, np.uint8)
        for x, y in np.random.default_rng(0).integers(20, 180, (8, 2)):
            depth[y:y + 40, x:x + 60], color[y:y + 40, x:x + 60] = 1000 + 5 * x, x
        images = (self.bridge.cv2_to_imgmsg(depth, "16UC1"), self.bridge.cv2_to_imgmsg(color, "bgr8"))
        publishers = [self.publisher(topic) for topic in ("depth_registered/image_raw", "rgb/image")]

        def ended():
            self.publish(publishers, images)
            return program.poll() is not None

        self.assertTrue(wait_until(ended, PATIENCE))
        said, _ = program.communicate()
        self.assertEqual(program.returncode, 0, said)
        self.assertIn("fits: no shift is clearly better", said)
        self.assertTrue((self.folder / "o.png").exists())

    def test_check_rig_names_the_silent_topic(self):
        program = self.program("check_rig", "--live", "--timeout", 0.2, "--output", self.folder / "o.png")
        said, _ = program.communicate(timeout=PATIENCE)
        self.assertEqual(program.returncode, 2, said)
        self.assertEqual(said, f"check_rig: nothing came on {self.topic('depth_registered/image_raw')} for 0.2 s\n")


if __name__ == "__main__":
    run_tests(__file__)
