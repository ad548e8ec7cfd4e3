# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests share that kill processes of all_in_focus.launch."""
import itertools
import time

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from depth_testing import TIMEOUT, GraphTest, camera_info, image_message, pixels_of, transform, two_planes, wait_until
from fusion_testing import regions
from process_testing import kill, pid_of

STAMPS = itertools.count(1000)


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
        self.assertTrue(wait_until(self.works), 'nothing works at the start')

    def works(self):
        """Labels of a depth image, and a bracket of one frame is fused."""
        stamp = next(STAMPS)
        self.depth.publish(image_message(two_planes(), stamp))
        self.colour.publish(image_message(np.full((48, 64, 3), 7, np.uint8), stamp, 'bgr8', 'color'))
        self.colour.publish(image_message(np.full((48, 64, 3), 7, np.uint8), stamp + 5, 'bgr8', 'color'))  # after a gap
        next(itertools.islice(STAMPS, 20, 20), None)
        labels = self.labels.at(stamp, timeout=1.0)
        return labels is not None and np.array_equal(pixels_of(labels), regions()) and self.fused.at(stamp, timeout=1.0)

    def assert_works_after_kill(self, process):
        begun = time.monotonic()
        killed = kill('/rig/' + process)

        def works_again():
            return pid_of('/rig/' + process) not in (None, killed) and self.works()
        self.assertTrue(wait_until(works_again), f'{process} was killed: no results within {TIMEOUT:.0f} s')
        rospy.loginfo('%s was killed: right again after %.1f s', process, time.monotonic() - begun)
