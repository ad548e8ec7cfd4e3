#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_focus --live: one bracket of a running camera gives the table that the same files give."""
import cv2
import rospy
from sensor_msgs.msg import Image

from camera_testing import CameraTest
from depth_testing import image_message, run_tests
from file_helpers import SCRIPTS, fork_script, run_script
from test_calibrate_focus import FOCUS, board, photograph

CAMERA = SCRIPTS / "image_folder_camera"


class CalibrateFocusTest(CameraTest):
    def setUp(self):
        super().setUp()
        (self.folder / "stack").mkdir()
        for index, focus in enumerate(FOCUS):
            cv2.imwrite(str(self.folder / "stack" / f"{index:02}.png"), photograph(board(), focus))
        cv2.imwrite(str(self.folder / "depth.png"), board())

    def table(self, name, *arguments):
        done = fork_script("calibrate_focus", *arguments, "--output", self.folder / name)
        self.assertEqual(done.returncode, 0, done.stderr)
        return (self.folder / name).read_text()

    def test_a_bracket_of_a_running_camera(self):
        self.start(CAMERA, stack=self.folder / "stack", rate=10.0, loop=True)
        depth = rospy.Publisher(self.topic("depth_registered/image_raw"), Image, queue_size=1, latch=True)
        depth.publish(image_message(board(), 1.0, "16UC1", "color"))
        live = self.table("live.yaml", "--live", "--timeout", 120, f"__ns:={self.namespace}")
        self.assertEqual(live, self.table("files.yaml", "--stack", self.folder / "stack", "--registered-depth",
                                          self.folder / "depth.png"))

    def test_what_is_missing_is_named(self):
        done = run_script("calibrate_focus", "--live", "--timeout", 1, "--output", self.folder / "t.yaml",
                          f"__ns:={self.namespace}")
        self.assertEqual(done.returncode, 2)
        self.assertIn("no depth came on depth_registered/image_raw", done.stderr)
        self.assertFalse((self.folder / "t.yaml").exists())


if __name__ == "__main__":
    run_tests(__file__)
