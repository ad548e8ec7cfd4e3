#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time that goes on and jumps back, as stamps tell it. fusion_sim_time_test.py: what /clock adds."""
import rospy
from sensor_msgs.msg import CameraInfo

from depth_testing import camera_info, run_tests, values_of, wait_until
from fusion_testing import BRACKET_IDS, PERIOD
from time_testing import STARTS, RoundsTest, TimeTest


class GapTest(TimeTest):
    RIG = '/plain'

    def test_a_pause_ends_a_bracket(self):
        self.reconfigure(bracket_gap=0.5)
        start = rospy.get_time()
        for index, sharp in enumerate(('near', 'far')):
            self.send_frame(start + index / 1024, sharp)
        self.assert_fused_by_sharpness(start, near=0, far=1)

    def test_a_bracket_that_a_pause_cuts_short_says_so(self):
        self.reconfigure(bracket_gap=0.5, bracket_size=5)
        start = rospy.get_time()
        for index, sharp in enumerate(('near', 'far')):
            self.send_frame(start + index / 1024, sharp)
        self.assertTrue(wait_until(lambda: self.outputs['report'].messages))
        self.assert_noted(self.outputs['report'].messages[-1], 'only 2 of 5 frames were used')

    def test_a_jump_back_ends_a_bracket(self):
        self.reconfigure(bracket_size=4)
        self.expect_labels()
        start = next(STARTS)
        for now, frames in ((start + 500, ('near', 'far', 'none')), (start, ('none', 'far', 'near', 'none'))):
            self.deliver_labels(now)  # shows the jump first
            for index, sharp in enumerate(frames):
                self.send_frame(now + index * PERIOD, sharp)
                self.acknowledged(now + index * PERIOD)
        report = self.assert_fused(start + 500 + 2 * PERIOD, near=0, far=1)
        self.assertEqual([report.frames_used, report.label_stamp.to_sec()], [3, start + 500])
        report = self.assert_fused(start + 2 * PERIOD, near=2, far=1)
        self.assertEqual([report.frames_used, report.label_stamp.to_sec()], [4, start])


class JumpTest(RoundsTest):
    def test_labels_come_first(self):
        self.play_to_the_end()
        self.deliver_labels(self.start)
        self.assert_all_is_well(self.send_bracket(self.start))

    def test_frames_come_first(self):
        self.play_to_the_end()
        self.assert_frames_wait_for_labels()

    def test_camera_info_comes_first(self):
        info = self.talk(self.topic('rgb/camera_info'), CameraInfo)
        info.say(camera_info(self.start + 300, 'color'))
        self.play_to_the_end()
        self.deliver(self.node, (info, camera_info(self.start, 'color')))
        self.assert_frames_wait_for_labels()

    def test_the_same_jump_shows_twice(self):
        self.play_to_the_end()
        middle = self.send_bracket(self.start)
        self.deliver_labels(self.start + 300.5)  # was still under way
        self.deliver_labels(self.start)
        report = self.report(middle)
        self.assertEqual([report.frames_used, report.frames_missing], [3, 0])
        middle = self.send_bracket(self.start + 10)
        self.assertIsNone(self.processed.at(self.start + 10, timeout=0.3))
        self.send_labels(self.start + 10)
        self.assert_fused(middle)

    def test_the_last_picture_of_before_comes_after_the_jump(self):
        self.play_to_the_end()
        last = self.announce_last(self.start + 300 + 2 * PERIOD, self.cut)
        self.deliver_labels(self.start)
        self.image.say(last)
        self.acknowledged(self.start + 300 + 2 * PERIOD)
        self.assert_all_is_well(self.send_bracket(self.start), cut_frames=3)

    def test_the_last_picture_of_a_round_of_less_than_a_second_comes_after_the_jump(self):
        """Its stamp does not tell that it is of before."""
        now, bracket = self.start + 0.5, next(BRACKET_IDS)
        self.send_labels(now)
        for index, sharp in enumerate(('both', 'none')):
            self.send_frame(now + index * PERIOD, sharp, bracket_id=bracket, index=index, count=3)
            self.acknowledged(now + index * PERIOD)
        last = self.announce_last(now + 2 * PERIOD, bracket)
        self.deliver_labels(self.start)
        self.image.say(last)
        self.acknowledged(now + 2 * PERIOD)
        report = self.report(now + PERIOD)
        self.assertEqual([report.bracket_id, report.frames_used, report.frames_missing], [bracket, 3, 0])
        self.assert_next_bracket_is_good(self.start + 10)

    def test_the_last_picture_of_before_comes_too_late(self):
        self.play_to_the_end()
        last = self.announce_last(self.start + 300 + 2 * PERIOD, self.cut)
        self.deliver_labels(self.start)
        middle = self.send_bracket(self.start)
        self.acknowledged(middle)
        self.image.say(last)
        self.assert_all_is_well(middle)

    def test_jumps_are_counted(self):
        jumps = lambda: int(values_of(self.diagnostics.next(self.node))['backward time jumps'])
        self.play_to_the_end()
        before = jumps()
        for now in (50, 10, 51, 11, 52, 12):  # stamps that did not come before
            self.assert_next_bracket_is_good(self.start + now)
        self.assertTrue(wait_until(lambda: jumps() == before + 4))


if __name__ == '__main__':
    run_tests(__file__)
