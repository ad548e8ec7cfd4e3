#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A bag that is played in a loop: every frame is processed, diagnostics go on."""
import time

import rospy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image

from depth_testing import GraphTest, Talker, image_message, run_tests, subscribers_of, two_planes, values_of

START, FRAMES, LOOPS = 100, 4, 3


class BagLoopTest(GraphTest):
    def test_frames_before_and_after_the_clock(self):
        clock = Talker('/clock', Clock)
        self.addCleanup(clock.publisher.unregister)
        clock.wait_for(len(subscribers_of('/clock')))  # this process is one
        depth = self.talk('/alone/depth_registered/image', Image)
        labels = self.listen('/alone/segmentation/labels', Image)
        for loop in range(LOOPS):
            labels.messages.clear()
            for stamp in range(START, START + FRAMES):
                frame = image_message(two_planes(), stamp)
                # Both orders happen: they are two connections.
                for message in (frame, None) if loop % 2 else (None, frame):
                    depth.say(message) if message else clock.say(Clock(rospy.Time(stamp)))
                    time.sleep(0.05)
                self.assertIsNotNone(labels.at(stamp), (loop, stamp))
        status = self.diagnostics.wait('alone/segmenter', lambda s: s.level == 0)
        self.assertEqual(values_of(status)['processed'], str(LOOPS * FRAMES))


if __name__ == '__main__':
    run_tests(__file__)
