#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""After kill -9 of any process of all_in_focus.launch results come again."""
import itertools
import os
import signal
import time
import xmlrpc.client

import numpy as np
import rosgraph
import rospy
import rostest
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from depth_testing import GraphTest, camera_info, image_message, pixels_of, two_planes, wait_until
from fusion_testing import regions

STAMPS = itertools.count(1000)
RECOVERY = 10  # s
PROCESSES = ('all_in_focus_manager', 'depth_preprocess', 'segmenter', 'fusion')


def pid_of(node):
    """None while the node is not there."""
    try:
        return xmlrpc.client.ServerProxy(rosgraph.Master('/test').lookupNode(node)).getPid('/test')[2]
    except (OSError, rosgraph.MasterError):
        return None


class RespawnTest(GraphTest):
    def setUp(self):
        super().setUp()
        self.transforms = rospy.Publisher('/tf_static', TFMessage, queue_size=1, latch=True)
        transform = TransformStamped(child_frame_id='depth')
        transform.header.frame_id = 'color'
        transform.transform.rotation.w = 1.0
        self.transforms.publish(TFMessage([transform]))
        self.depth = rospy.Publisher('/rig/depth/image_raw', Image, queue_size=5)
        self.infos = {name: rospy.Publisher('/rig/%s/camera_info' % name, CameraInfo, queue_size=5, latch=True)
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

    def test_results_come_again_after_a_kill(self):
        self.assertTrue(wait_until(self.works, 30), 'nothing works at the start')
        # A loader whose manager dies in its first seconds, before their bond is formed, has been seen to miss it.
        wait_until(lambda: False, 6)
        for process in PROCESSES:
            killed = pid_of('/rig/' + process)
            os.kill(killed, signal.SIGKILL)
            begun = time.monotonic()
            replaced = lambda: pid_of('/rig/' + process) not in (None, killed)
            self.assertTrue(wait_until(replaced, 30), process + ' was not started again')
            self.assertTrue(wait_until(self.works, 30), 'nothing works after the kill of ' + process)
            rospy.loginfo('after the kill of %s: %.1f s', process, time.monotonic() - begun)
            wait_until(lambda: False, 6)  # bonds of the killed one are broken by then
            self.assertTrue(wait_until(self.works, RECOVERY), 'nothing works a while after the kill of ' + process)


if __name__ == '__main__':
    rospy.init_node('respawn_test')
    rostest.rosrun('all_in_focus', 'respawn', '__main__')
