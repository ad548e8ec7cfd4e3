#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the fusion promises to those who send frames: when it acknowledges, in which order it publishes, what it warns of."""
import itertools
import os
import signal

import rosgraph
import rospy

from all_in_focus.msg import FocusFrame
from depth_testing import SANITIZED, WARN, hears, run_tests, values_of, wait_until
from fusion_testing import BRACKET_IDS, PERIOD, FusionTest, colour_message, scene
from refined_testing import INDICES, MIDDLE, RefinedTest, pixels

STAMPS = itertools.count(600000, 10)
ENLARGED = 4 if SANITIZED else 8  # restoration takes long then
AT_REFERENCE = MIDDLE * PERIOD


class RestoredTest(RefinedTest):
    def reconfigure(self, **config):
        return super().reconfigure(**{'mode': 'restored', **config})

    def send_large(self):
        """A bracket that takes long to restore; returns its stamp."""
        stamp = next(STAMPS)
        self.send_scene(stamp)
        self.send(stamp, replaced={i: lambda at, i=i: colour_message(pixels(i, ENLARGED), at) for i in INDICES})
        return stamp

    def test_the_last_frame_is_acknowledged_after_its_result(self):
        self.expect_scene()
        stamp = self.send_large()
        self.acknowledged(stamp + INDICES[-1] * PERIOD)
        report = self.outputs['report'].at(stamp + AT_REFERENCE, timeout=0.5)  # another connection
        self.assertIsNotNone(report, 'acknowledged before the report')
        self.assertEqual(report.mode, 'restored', report.notes)

    def test_an_older_result_never_follows_a_newer_one(self):
        self.expect_scene()
        stamps = []
        for _ in range(3):
            self.reconfigure()
            stamps.append(self.send_large())
            self.acknowledged(stamps[-1] + INDICES[-2] * PERIOD)
            self.reconfigure(bracket_mode='sliding')
            stamps.append(next(STAMPS))
            self.send_scene(stamps[-1])
            self.send(stamps[-1])
            self.acknowledged(stamps[-1] + INDICES[-1] * PERIOD)
        self.report(stamps[-1])
        reported = [r.header.stamp.to_sec() for r in self.outputs['report'].messages]
        self.assertEqual(reported, sorted(reported))
        self.assertTrue({stamp + AT_REFERENCE for stamp in stamps[::2]} <= set(reported))


class MismatchTest(FusionTest):
    def test_a_focus_stamp_that_is_off_is_told_of(self):
        stamp, bracket_id = next(STAMPS), next(BRACKET_IDS)
        for index in range(70):
            at = stamp + index * PERIOD
            self.send_frame(at, 'both')
            focus = FocusFrame(bracket_id=bracket_id, index=index)
            focus.header.stamp = rospy.Time.from_sec(at) + rospy.Duration(0, 1000)
            self.focus.say(focus)
            rospy.sleep(0.1)
        self.assert_diagnosed(WARN, 'colour frames wait for a rgb/focus message of the same stamp', 'differs by 1e-06 s')
        self.assert_next_bracket_is_good(next(STAMPS))

    def send_without_publisher_of_focus(self):
        """Three frames after the publisher of rgb/focus has gone; they are fused as plain ones."""
        self.reconfigure(bracket_size=3)
        self.focus.publisher.unregister()
        self.talkers.remove(self.focus)
        self.assertTrue(wait_until(lambda: not hears('/manager', self.focus.topic)))
        stamp = next(STAMPS)
        self.send_labels(stamp)
        for index, sharp in enumerate(('none', 'near', 'far')):
            self.send_frame(stamp + index * PERIOD, sharp)
        self.assert_fused(stamp + PERIOD)

    def test_without_a_publisher_of_focus_its_brackets_are_those_of_plain_frames(self):
        self.assert_next_bracket_is_good(next(STAMPS))
        rospy.sleep(2)  # all publishers are known by then
        self.send_without_publisher_of_focus()

    def test_a_publisher_of_focus_may_go_before_the_others_are_known(self):
        self.assert_next_bracket_is_good(next(STAMPS))
        self.send_without_publisher_of_focus()

    def test_a_bracket_whose_last_frame_is_lost_is_told_of(self):
        stamp, bracket_id = next(STAMPS), next(BRACKET_IDS)
        for index in (0, 1):
            self.send_frame(stamp + index * PERIOD, 'both', bracket_id=bracket_id, index=index, count=3)
        self.assert_diagnosed(WARN, f'bracket {bracket_id} is open and no frame has come for 10 s')
        self.finish()
        self.assert_noted(self.report(stamp + PERIOD), '1 frames never came')

    def test_a_first_frame_of_another_size_costs_that_frame_only(self):
        self.expect_labels()
        stamp = next(STAMPS)
        self.send_labels(stamp)
        self.send_bracket(stamp, (colour_message(scene()[:24, :32], stamp), 'none', 'near', 'far'))
        report = self.assert_fused(stamp + 2 * PERIOD, near=2, far=3)
        self.assertEqual([report.frames_used, report.frames_rejected], [3, 1])
        self.assert_noted(report, 'frame 0 rejected', 'the frame is 32x24, most of the bracket is 64x48')


class MasterTest(FusionTest):
    RIG = '/plain'

    def test_a_master_that_does_not_answer_stops_no_frame(self):
        """The first frames after a subscription, while nobody publishes rgb/focus."""
        self.reconfigure(bracket_size=3)
        self.assertTrue(wait_until(lambda: self.image.publisher.get_num_connections() > 0))
        master, stamp = rosgraph.Master('/test').getPid(), next(STAMPS)
        os.kill(master, signal.SIGSTOP)
        try:
            for index, sharp in enumerate(('none', 'near', 'far')):
                self.send_frame(stamp + index * PERIOD, sharp)
            for index in range(3):
                self.acknowledged(stamp + index * PERIOD)
            self.assert_fused_by_sharpness(stamp + PERIOD)
        finally:
            os.kill(master, signal.SIGCONT)


class JitterTest(RefinedTest):
    def test_stamps_of_one_input_that_jump_reset_nothing(self):
        """Two publishers of camera_info or of depth, one of them with another clock."""
        depth = ('depth_registered/image', 'depth_registered/image_raw')
        jumps = lambda: values_of(self.diagnostics.next(self.node))['backward time jumps']
        self.expect_scene()
        before = jumps()
        for names in (('rgb/camera_info',), depth, (*depth, 'rgb/camera_info')):
            stamp = next(STAMPS)
            self.send_scene(stamp)
            bracket_id = next(BRACKET_IDS)
            for index in INDICES:
                at = stamp - 5 if index % 2 else stamp + index * PERIOD
                self.deliver(self.node, *(self.part_of(name, at) for name in names))
                self.send(stamp, indices=[index], bracket_id=bracket_id)
            self.assertEqual(list(self.assert_as_files(stamp, INDICES, MIDDLE).notes), [])
        self.assertEqual(jumps(), before)


if __name__ == '__main__':
    run_tests(__file__)
