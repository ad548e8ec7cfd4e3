#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the fusion does with time from /clock, which tells more than stamps."""
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock

from depth_testing import WARN, run_tests, wait_until
from fusion_testing import BRACKET_IDS, PERIOD, regions
from time_testing import STARTS, RoundsTest, TimeTest


class ClockTest(TimeTest):
    def setUp(self):
        self.clock = rospy.Publisher('/clock', Clock, queue_size=10)
        super().setUp()

    def tearDown(self):
        super().tearDown()
        self.clock.unregister()

    def set_clock(self, now):
        """Returns when the node knows: it stamps its diagnostics."""
        stamps = []
        listener = rospy.Subscriber('/diagnostics', DiagnosticArray, lambda array: stamps.append(array.header.stamp.to_sec())
                                    if array.status[0].name.startswith(self.RIG[1:]) else None)

        def known():
            self.clock.publish(Clock(clock=rospy.Time.from_sec(now)))
            return now in stamps
        self.assertTrue(wait_until(known))
        listener.unregister()


class GapTest(ClockTest):
    RIG = '/plain'

    def test_a_gap_ends_a_bracket_without_another_frame(self):
        self.reconfigure(bracket_gap=2.0)
        start = next(STARTS)
        for index, sharp in enumerate(('near', 'none', 'far')):
            self.set_clock(start + index)
            self.send_frame(start + index, sharp)
            self.acknowledged(start + index)
        self.set_clock(start + 3.5)
        self.assertIsNone(self.outputs['report'].at(start, timeout=0.5))
        self.set_clock(start + 5)
        self.assert_fused_by_sharpness(start, near=0, far=2)

    def test_a_frame_of_before_the_jump_is_kept_apart(self):
        self.reconfigure(bracket_gap=5.0)
        start = next(STARTS)
        self.set_clock(start + 500)
        self.send_frame(start + 500, 'none')
        self.acknowledged(start + 500)
        self.set_clock(start)
        self.send_frame(start + 500 + PERIOD, 'both')
        for index, sharp in enumerate(('near', 'far')):
            self.send_frame(start + index * PERIOD, sharp)
            self.acknowledged(start + index * PERIOD)
        self.finish()
        self.assertEqual(self.assert_fused_by_sharpness(start, near=0, far=1).frames_used, 2)
        self.assert_noted(self.report(start + 500 + PERIOD), 'only one frame')


class EndTest(ClockTest):
    def test_a_bracket_that_is_open_when_the_bag_ends_is_told_of(self):
        start, bracket_id = next(STARTS), next(BRACKET_IDS)
        self.set_clock(start)
        self.send_frame(start, 'both', bracket_id=bracket_id, index=0, count=2)
        self.assert_diagnosed(WARN, f'bracket {bracket_id} is open and no frame has come for 10 s')
        self.finish()


class JumpTest(ClockTest, RoundsTest):
    def test_labels_come_first(self):
        self.play_to_the_end()
        self.set_clock(self.start)
        self.deliver_labels(self.start)
        self.assert_all_is_well(self.send_bracket(self.start))

    def test_a_label_of_before_comes_after_the_jump(self):
        self.play_to_the_end()
        self.set_clock(self.start)
        self.send_labels(self.start + 300.5, 3 - regions())  # the segmenter had not been ready
        self.assert_frames_wait_for_labels()

    def test_a_frame_of_before_comes_after_the_jump(self):
        self.play_to_the_end()
        self.set_clock(self.start)
        self.send_frame(self.start + 300 + 2 * PERIOD, 'both', bracket_id=self.cut, index=2, count=3)
        self.acknowledged(self.start + 300 + 2 * PERIOD)  # its bracket has ended
        self.assert_frames_wait_for_labels()

    def test_the_clock_follows_later(self):
        self.play_to_the_end()
        self.send_labels(self.start)
        middle = self.send_bracket(self.start)
        self.report(middle)
        self.set_clock(self.start + 1)
        self.assert_all_is_well(middle)


if __name__ == '__main__':
    run_tests(__file__)
