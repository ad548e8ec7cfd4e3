#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time that goes on and jumps back: with sim time on /clock too, else on stamps alone."""
import itertools
import unittest

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo

from all_in_focus.msg import FocusFrame
from depth_testing import camera_info, run_tests, values_of, wait_until
from fusion_testing import BRACKET_IDS, PERIOD, FusionTest, colour_message, picture, regions

STARTS = itertools.count(10000, 1000)
SIM_TIME = rospy.get_param('/use_sim_time', False)


class TimeTest(FusionTest):
    def setUp(self):
        self.clock = rospy.Publisher('/clock', Clock, queue_size=10) if SIM_TIME else None
        super().setUp()

    def tearDown(self):
        super().tearDown()
        if SIM_TIME:
            self.clock.unregister()

    def set_clock(self, now):
        """Returns when the node knows: it stamps its diagnostics."""
        if not SIM_TIME:
            return
        stamps = []
        listener = rospy.Subscriber('/diagnostics', DiagnosticArray, lambda array: stamps.append(array.header.stamp.to_sec())
                                    if array.status[0].name.startswith(self.RIG[1:]) else None)

        def known():
            self.clock.publish(Clock(clock=rospy.Time.from_sec(now)))
            return now in stamps
        self.assertTrue(wait_until(known))
        listener.unregister()


class GapTest(TimeTest):
    RIG = '/plain'

    @unittest.skipUnless(SIM_TIME, 'needs /clock')
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

    @unittest.skipIf(SIM_TIME, 'needs the time of the wall')
    def test_a_pause_ends_a_bracket(self):
        self.reconfigure(bracket_gap=0.5)
        start = rospy.get_time()
        for index, sharp in enumerate(('near', 'far')):
            self.send_frame(start + index / 1024, sharp)
        self.assert_fused_by_sharpness(start, near=0, far=1)

    def test_a_jump_back_ends_a_bracket(self):
        self.reconfigure(bracket_size=4)
        self.expect_labels()
        start = next(STARTS)
        for now, frames in ((start + 500, ('near', 'far', 'none')), (start, ('none', 'far', 'near', 'none'))):
            self.set_clock(now)
            self.send_labels(now)  # shows the jump first
            wait_until(lambda: False, 0.2)
            for index, sharp in enumerate(frames):
                self.send_frame(now + index * PERIOD, sharp)
                self.acknowledged(now + index * PERIOD)
        report = self.assert_fused(start + 500 + 2 * PERIOD, near=0, far=1)
        self.assertEqual([report.frames_used, report.label_stamp.to_sec()], [3, start + 500])
        report = self.assert_fused(start + 2 * PERIOD, near=2, far=1)
        self.assertEqual([report.frames_used, report.label_stamp.to_sec()], [4, start])

    @unittest.skipUnless(SIM_TIME, 'needs /clock')
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


class JumpTest(TimeTest):
    """A bag that is played over and over."""

    def setUp(self):
        super().setUp()
        self.expect_labels()
        self.start = next(STARTS)

    def play_to_the_end(self):
        """Several brackets, one of them is open at the end."""
        for now in (self.start + 100, self.start + 200):
            self.set_clock(now)
            self.assert_next_bracket_is_good(now)
        now, self.cut = self.start + 300, next(BRACKET_IDS)
        self.set_clock(now)
        self.send_labels(now)
        for index, sharp in enumerate(('both', 'none')):
            self.send_frame(now + index * PERIOD, sharp, bracket_id=self.cut, index=index, count=3)
            self.acknowledged(now + index * PERIOD)

    def assert_all_is_well(self, middle, cut_frames=2):
        report = self.assert_fused(middle)
        self.assertEqual([report.frames_seen, report.frames_used, report.frames_missing], [3, 3, 0])
        self.assertEqual(report.label_stamp, rospy.Time.from_sec(self.start))
        for index in range(3):
            self.acknowledged(self.start + index * PERIOD)
        cut = self.report(self.start + 300 + PERIOD)
        self.assertEqual([cut.bracket_id, cut.frames_used, cut.frames_missing], [self.cut, cut_frames, 3 - cut_frames])
        self.set_clock(self.start + 10)
        self.assert_next_bracket_is_good(self.start + 10)

    def announce_last(self, stamp, bracket):
        """rgb/focus says that a bracket ends with a frame. Returns the frame, which is not sent yet."""
        last = colour_message(picture('both'), stamp)
        self.focus.say(FocusFrame(last.header, bracket, 2, 3, True, float('nan')))
        return last

    def assert_frames_wait_for_labels(self, cut_frames=2):
        middle = self.send_bracket(self.start)
        self.assertIsNone(self.processed.at(self.start, timeout=0.3))
        self.send_labels(self.start)
        self.assert_all_is_well(middle, cut_frames)

    def test_labels_come_first(self):
        self.play_to_the_end()
        self.set_clock(self.start)
        self.send_labels(self.start)
        self.assert_all_is_well(self.send_bracket(self.start))

    def test_frames_come_first(self):
        self.play_to_the_end()
        self.set_clock(self.start)
        self.assert_frames_wait_for_labels()

    def test_camera_info_comes_first(self):
        info = self.talk(self.topic('rgb/camera_info'), CameraInfo)
        info.say(camera_info(self.start + 300, 'color'))
        self.play_to_the_end()
        self.set_clock(self.start)
        info.say(camera_info(self.start, 'color'))
        wait_until(lambda: False, 0.2)
        self.assert_frames_wait_for_labels()

    @unittest.skipIf(SIM_TIME, 'the clock tells')
    def test_the_same_jump_shows_twice(self):
        self.play_to_the_end()
        middle = self.send_bracket(self.start)
        self.send_labels(self.start + 300.5)  # was still under way
        wait_until(lambda: False, 0.2)
        self.send_labels(self.start)
        report = self.report(middle)
        self.assertEqual([report.frames_used, report.frames_missing], [3, 0])
        self.assert_next_bracket_is_good(self.start + 10)

    @unittest.skipUnless(SIM_TIME, 'needs /clock')
    def test_a_label_of_before_comes_after_the_jump(self):
        self.play_to_the_end()
        self.set_clock(self.start)
        self.send_labels(self.start + 300.5, 3 - regions())  # the segmenter had not been ready
        self.assert_frames_wait_for_labels()

    @unittest.skipUnless(SIM_TIME, 'needs /clock')
    def test_a_frame_of_before_comes_after_the_jump(self):
        self.play_to_the_end()
        self.set_clock(self.start)
        self.send_frame(self.start + 300 + 2 * PERIOD, 'both', bracket_id=self.cut, index=2, count=3)
        self.acknowledged(self.start + 300 + 2 * PERIOD)  # its bracket is whole
        self.assert_frames_wait_for_labels(cut_frames=3)

    def test_the_last_picture_of_before_comes_after_the_jump(self):
        self.play_to_the_end()
        last = self.announce_last(self.start + 300 + 2 * PERIOD, self.cut)
        self.set_clock(self.start)
        self.send_labels(self.start)
        wait_until(lambda: False, 0.2)
        self.image.say(last)
        self.acknowledged(self.start + 300 + 2 * PERIOD)
        self.assert_all_is_well(self.send_bracket(self.start), cut_frames=3)

    def test_the_last_picture_of_a_round_of_less_than_a_second_comes_after_the_jump(self):
        """Its stamp does not tell that it is of before."""
        now, bracket = self.start + 0.5, next(BRACKET_IDS)
        self.set_clock(now)
        self.send_labels(now)
        for index, sharp in enumerate(('both', 'none')):
            self.send_frame(now + index * PERIOD, sharp, bracket_id=bracket, index=index, count=3)
            self.acknowledged(now + index * PERIOD)
        last = self.announce_last(now + 2 * PERIOD, bracket)
        self.set_clock(self.start)
        self.send_labels(self.start)
        wait_until(lambda: False, 0.2)
        self.image.say(last)
        self.acknowledged(now + 2 * PERIOD)
        report = self.report(now + PERIOD)
        self.assertEqual([report.bracket_id, report.frames_used, report.frames_missing], [bracket, 3, 0])
        self.set_clock(self.start + 10)
        self.assert_next_bracket_is_good(self.start + 10)

    def test_the_last_picture_of_before_comes_too_late(self):
        self.play_to_the_end()
        last = self.announce_last(self.start + 300 + 2 * PERIOD, self.cut)
        self.set_clock(self.start)
        self.send_labels(self.start)
        middle = self.send_bracket(self.start)
        self.acknowledged(middle)
        self.image.say(last)
        self.assert_all_is_well(middle)

    @unittest.skipUnless(SIM_TIME, 'needs /clock')
    def test_the_clock_follows_later(self):
        self.play_to_the_end()
        self.send_labels(self.start)
        middle = self.send_bracket(self.start)
        self.report(middle)
        self.set_clock(self.start + 1)
        self.assert_all_is_well(middle)

    def test_jumps_are_counted(self):
        jumps = lambda: int(values_of(self.diagnostics.wait('focus/fusion', lambda s: True))['backward time jumps'])
        self.play_to_the_end()
        before = jumps()
        for now in (50, 10, 51, 11, 52, 12):  # stamps that did not come before
            self.set_clock(self.start + now)
            self.assert_next_bracket_is_good(self.start + now)
        self.assertTrue(wait_until(lambda: jumps() == before + 4))


if __name__ == '__main__':
    run_tests(__file__)
