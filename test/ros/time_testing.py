# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of time that jumps back share: a bag that is played over and over."""
import itertools

import rospy

from all_in_focus.msg import FocusFrame
from fusion_testing import BRACKET_IDS, PERIOD, FusionTest, colour_message, picture

STARTS = itertools.count(10000, 1000)


class TimeTest(FusionTest):
    def set_clock(self, now):
        """Without /clock stamps alone tell the time."""


class RoundsTest(TimeTest):
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
        self.deliver(self.node, (self.focus, FocusFrame(last.header, bracket, 2, 3, True, float('nan'))))
        return last

    def assert_frames_wait_for_labels(self, cut_frames=2):
        middle = self.send_bracket(self.start)
        self.assertIsNone(self.processed.at(self.start, timeout=0.3))
        self.send_labels(self.start)
        self.assert_all_is_well(middle, cut_frames)
