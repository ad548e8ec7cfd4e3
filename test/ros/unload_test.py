#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The nodelets are loaded and unloaded while they are at work: the manager lives, and what is loaded next works."""
import itertools
import threading
import time

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from all_in_focus.msg import FocusFrame, FusionReport
from depth_testing import GraphTest, camera_info, image_message, run_tests, transform, two_planes, wait_until
from fusion_testing import colour_message, picture
from unload_testing import Manager

NODELETS = ('depth_preprocess', 'segmenter', 'fusion')
FRAMES = ('none', 'near', 'far')
PERIOD = 0.02  # s, of the messages: nodelets are at work whenever they are unloaded


class Traffic:
    """A depth image and a colour frame every 20 ms, and subscribers that come and go."""

    def __init__(self):
        self.transforms = rospy.Publisher('/tf_static', TFMessage, queue_size=1, latch=True)
        self.transforms.publish(TFMessage([transform('depth')]))
        self.publishers = {topic: rospy.Publisher(topic, kind, queue_size=10) for topic, kind in (
            ('depth/image_raw', Image), ('depth/camera_info', CameraInfo), ('rgb/camera_info', CameraInfo),
            ('rgb/image', Image), ('rgb/focus', FocusFrame))}
        self.results = {'labels': [], 'reports': []}
        self.subscribers = [rospy.Subscriber('segmentation/labels', Image, self.results['labels'].append),
                            rospy.Subscriber('all_in_focus/report', FusionReport, self.results['reports'].append)]
        self.ended = threading.Event()
        self.threads = [threading.Thread(target=run) for run in (self.send, self.come_and_go)]
        for thread in self.threads:
            thread.start()

    def send(self):
        pictures, depth = [picture(sharp) for sharp in FRAMES], two_planes()
        for number in itertools.count():
            if self.ended.wait(PERIOD):
                return
            bracket, index = divmod(number, len(FRAMES))
            stamp, frame = time.time(), colour_message(pictures[index], time.time())
            messages = {'depth/camera_info': camera_info(stamp, 'depth'), 'rgb/camera_info': camera_info(stamp, 'color'),
                        'depth/image_raw': image_message(depth, stamp), 'rgb/image': frame,
                        'rgb/focus': FocusFrame(header=frame.header, bracket_id=bracket, index=index, count=len(FRAMES))}
            for topic, message in messages.items():
                self.publishers[topic].publish(message)

    def come_and_go(self):
        topics = itertools.cycle(('depth_registered/image_raw', 'segmentation/image_color', 'all_in_focus/image'))
        while not self.ended.is_set():
            subscriber = rospy.Subscriber(next(topics), Image, lambda image: None)
            self.ended.wait(0.03)
            subscriber.unregister()

    def goes_on(self):
        """Whether more of every result comes."""
        before = {name: len(messages) for name, messages in self.results.items()}
        return wait_until(lambda: all(len(messages) > before[name] for name, messages in self.results.items()))

    def close(self):
        self.ended.set()
        for thread in self.threads:
            thread.join()
        for one in [*self.subscribers, *self.publishers.values(), self.transforms]:
            one.unregister()


class UnloadTest(GraphTest):
    def test_unloading_at_work_leaves_the_manager_alive(self):
        traffic, manager = Traffic(), Manager()
        self.addCleanup(traffic.close)
        cycles = rospy.get_param('~cycles')
        for cycle, ages in enumerate(np.random.default_rng(1).uniform(0, 0.5, (cycles, len(NODELETS)))):
            for nodelet in NODELETS:
                manager.load(nodelet)
            if cycle % 10 == 0 or cycle == cycles - 1:
                self.assertTrue(traffic.goes_on(), f'no results in cycle {cycle}')
            for nodelet, age in zip(NODELETS, ages):
                time.sleep(age)
                manager.unload(nodelet)
        rospy.loginfo('the manager lived through %d cycles', cycles)


if __name__ == '__main__':
    run_tests(__file__)
