#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A calibration that the Kinect node is given while it runs: a node of its own, which is started again."""
import tempfile
from pathlib import Path

import rospy
from rosgraph_msgs.msg import Log
from sensor_msgs.srv import SetCameraInfo

from depth_testing import TIMEOUT, run_tests, wait_until
from kinect_testing import KinectNode, KinectTest, plug, unplug


class CalibrationTest(KinectTest):
    def setUp(self):
        super().setUp()
        self.folder = tempfile.TemporaryDirectory()
        self.file = Path(self.folder.name) / 'new' / 'depth.yaml'
        self.start()

    def tearDown(self):
        self.node.stop()
        self.folder.cleanup()
        super().tearDown()

    def start(self):
        self.node = KinectNode('_device:=frames:one', f'_depth_camera_info_url:={self.file}',
                               '_rgb_camera_info_url:=/dev/null/rgb.yaml')

    def set_info(self, camera, info):
        name = f'/own/{camera}/set_camera_info'
        rospy.wait_for_service(name, TIMEOUT)
        return rospy.ServiceProxy(name, SetCameraInfo)(info)

    def test_calibration_that_is_set_is_kept(self):
        plug('one')
        infos = self.infos('/own/depth/camera_info')
        info = infos.wait(1)[0]
        info.K = [600.5, 0, 310, 0, 601.5, 250, 0, 0, 1]
        info.D = [0.1, -0.2, 0.001, 0.002, 0.0]
        info.P = [600.5, 0, 310, 0, 0, 601.5, 250, 0, 0, 0, 1, 0]
        answer = self.set_info('depth', info)
        self.assertTrue(answer.success, answer.status_message)
        self.assertIn('camera_name: kinect_depth', self.file.read_text())

        def is_used():
            return wait_until(lambda: infos.messages and (infos.messages[-1].K, infos.messages[-1].D) == (
                tuple(info.K), tuple(info.D)))

        self.assertTrue(is_used())
        unplug('one')
        self.status('own/kinect_openni2', 'cannot open "frames:one"')
        infos.messages.clear()
        plug('one')
        self.assertTrue(is_used())
        self.node.stop()
        infos.messages.clear()
        self.start()
        self.assertTrue(is_used())

    def test_calibration_that_cannot_be_stored(self):
        plug('one')
        log = self.images('/rosout', Log)
        infos = self.infos('/own/kinect_rgb/camera_info')
        info = infos.wait(1)[0]
        info.K = [600.5, 0, 310, 0, 601.5, 250, 0, 0, 1]
        answer = self.set_info('kinect_rgb', info)
        self.assertEqual((answer.success, answer.status_message), (False, 'Error storing camera calibration.'))
        self.assertTrue(wait_until(lambda: any('/dev/null' in line.msg and line.level >= Log.ERROR
                                               for line in log.messages)), [line.msg for line in log.messages])
        # It counts until the node ends.
        self.assertTrue(wait_until(lambda: infos.messages[-1].K[0] == 600.5))
        self.images('/own/depth/image_raw').wait(2)


if __name__ == '__main__':
    run_tests(__file__)
