#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Kinect's nodelet is loaded and unloaded while somebody listens: the manager lives, and images come."""
import time

import numpy as np
import rospy

from depth_testing import run_tests
from kinect_testing import KinectTest, plug
from unload_testing import Manager


class KinectUnloadTest(KinectTest):
    def test_unloading_at_work_leaves_the_manager_alive(self):
        plug('one')
        images, manager = self.images('/depth/image_raw'), Manager()
        cycles = rospy.get_param('~cycles')
        for cycle, age in enumerate(np.random.default_rng(1).uniform(0, 0.5, cycles)):
            manager.load('kinect_openni2')
            if cycle == cycles - 1:
                images.wait(5)
            time.sleep(age)
            manager.unload('kinect_openni2')


if __name__ == '__main__':
    run_tests(__file__)
