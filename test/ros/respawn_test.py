#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""After kill -9 of any process of all_in_focus.launch results are right again within 10 s."""
import itertools
import subprocess
import time

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from depth_testing import TIMEOUT, GraphTest, camera_info, image_message, pixels_of, run_tests, transform, two_planes, wait_until
from fusion_testing import regions
from process_testing import kill, pid_of

STAMPS = itertools.count(1000)
LOADERS = ('depth_preprocess', 'segmenter', 'fusion')


class RespawnTest(GraphTest):
    def setUp(self):
        super().setUp()
        self.transforms = rospy.Publisher('/tf_static', TFMessage, queue_size=1, latch=True)
        self.transforms.publish(TFMessage([transform('depth')]))
        self.depth = rospy.Publisher('/rig/depth/image_raw', Image, queue_size=5)
        self.infos = {name: rospy.Publisher(f'/rig/{name}/camera_info', CameraInfo, queue_size=5, latch=True)
                      for name in ('depth', 'rgb')}
        for name, frame in (('depth', 'depth'), ('rgb', 'color')):
            self.infos[name].publish(camera_info(1, frame))
        self.colour = rospy.Publisher('/rig/rgb/image', Image, queue_size=5)
        self.labels = self.listen('/rig/segmentation/labels', Image)
        self.fused = self.listen('/rig/all_in_focus/image', Image)

    def works(self):
        """Labels of a depth image, and a bracket of one frame is fused."""
        stamp = next(STAMPS)
        self.depth.publish(image_message(two_planes(), stamp))
        self.colour.publish(image_message(np.full((48, 64, 3), 7, np.uint8), stamp, 'bgr8', 'color'))
        labels = self.labels.at(stamp, timeout=0.5)
        self.colour.publish(image_message(np.full((48, 64, 3), 7, np.uint8), stamp + 5, 'bgr8', 'color'))  # after a gap
        fused = self.fused.at(stamp, timeout=0.5)
        next(itertools.islice(STAMPS, 20, 20), None)
        return labels is not None and fused is not None and np.array_equal(pixels_of(labels), regions())

    def assert_works_after_kill(self, process):
        begun = time.monotonic()
        killed = kill('/rig/' + process)

        def works_again():
            return pid_of('/rig/' + process) not in (None, killed) and self.works()
        self.assertTrue(wait_until(works_again), f'{process} was killed: no results within {TIMEOUT:.0f} s')
        rospy.loginfo('%s was killed: right again after %.1f s', process, time.monotonic() - begun)

    def test_manager_is_killed_at_any_age(self):
        """Also before its loaders can have heard of it twice, and before they have loaded anything."""
        self.assertTrue(wait_until(self.works), 'nothing works at the start')
        for age in (0, 0.5, 1, 1.5, 2, 6):
            time.sleep(age)
            self.assert_works_after_kill('all_in_focus_manager')
        for _ in range(3):
            kill('/rig/all_in_focus_manager')
            self.assertTrue(wait_until(lambda: pid_of('/rig/all_in_focus_manager')))
        self.assert_works_after_kill('all_in_focus_manager')

    def test_loader_is_killed(self):
        self.assertTrue(wait_until(self.works), 'nothing works at the start')
        for process in LOADERS:
            self.assert_works_after_kill(process)
            time.sleep(3)  # by then the next one has loaded its nodelet anew
            self.assertTrue(wait_until(self.works), 'nothing works a while after the kill of ' + process)

    def test_nodelet_is_unloaded_by_somebody(self):
        self.assertTrue(wait_until(self.works), 'nothing works at the start')
        subprocess.run(['rosrun', 'nodelet', 'nodelet', 'unload', '/rig/fusion', '/rig/all_in_focus_manager'], check=True)
        self.assertTrue(wait_until(self.works), 'the nodelet was not loaded again')


if __name__ == '__main__':
    run_tests(__file__)
