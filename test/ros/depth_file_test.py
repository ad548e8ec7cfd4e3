#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""depth_file_camera over ROS: an image again and again, and what it refuses."""
import cv2
import numpy as np
from sensor_msgs.msg import CameraInfo, Image

from camera_testing import CameraTest
from depth_testing import pixels_of, run_tests, wait_until
from file_helpers import SCRIPTS

NODE = SCRIPTS / "depth_file_camera"
SIZE = (64, 48)


class DepthFileTest(CameraTest):
    def setUp(self):
        super().setUp()
        self.depth = np.random.default_rng(0).integers(0, 5000, SIZE[::-1]).astype(np.uint16)
        cv2.imwrite(str(self.folder / "depth.png"), self.depth)

    def test_an_image_with_its_calibration_again_and_again(self):
        self.start(NODE, depth=self.folder / "depth.png", rig=self.save_rig(SIZE), frame_id="left_depth", rate=20.0)
        images, infos = self.listen("depth/image_raw", Image), self.listen("depth/camera_info", CameraInfo)
        # Either may have come before the other was listened to.
        both = lambda: (image for image in images.messages[2:] if infos.at(image.header.stamp.to_sec(), 0))
        image = wait_until(lambda: next(both(), None))
        self.assertIsNotNone(image)
        info = infos.at(image.header.stamp.to_sec())
        self.assertEqual([image.encoding, image.header.frame_id, info.header.frame_id], ["16UC1"] + 2 * ["left_depth"])
        np.testing.assert_array_equal(pixels_of(image), self.depth)
        self.assertEqual([info.width, info.K[0]], [SIZE[0], 60.0])
        self.assertLess(images.messages[0].header.stamp, image.header.stamp)

    def test_wrong_parameters_end_in_one_line(self):
        rig = self.save_rig((32, 24))
        self.assert_all_refused(NODE, [
            ({}, "~depth is missing"),
            ({"depth": self.folder / "none.png", "rig": rig}, "none.png: No such file"),
            ({"depth": self.folder / "depth.png", "rig": rig}, "depth.yaml says 32x24")])


if __name__ == "__main__":
    run_tests(__file__)
