#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What happens on real rigs: impossible stamps, cameras that take seconds, silence."""
import itertools

import numpy as np
import rospy
from sensor_msgs.msg import Image

from all_in_focus.msg import FocusFrame, FusionReport
from depth_testing import ERROR, WARN, camera_info, image_message, run_tests, two_planes, wait_until
from fusion_testing import BRACKET_IDS, PERIOD, FusionTest, colour_message, picture, regions
from refined_testing import FRAMES, INDICES, MIDDLE, RefinedTest, pixels

STAMPS = itertools.count(400000, 200)
LAST_STAMP = rospy.Time(4294967295, 950000000)
DEPTH_PERIOD = 1 / 32  # s, exact in binary
AT_ONCE = 32  # messages of a topic that are sent before the node has taken all: of two topics it matches 64


class StampTest(RefinedTest):
    def test_an_impossible_stamp_ends_no_node(self):
        self.expect_scene()
        good = {'rgb/image': colour_message(picture('both'), 0), 'rgb/focus': FocusFrame(),
                'rgb/camera_info': camera_info(0, 'color'), 'segmentation/labels': image_message(regions(), 0, '32SC1', 'color'),
                'depth_registered/image': image_message(two_planes(), 0),
                'depth_registered/image_raw': image_message(two_planes(), 0)}
        talkers = {'rgb/image': self.image, 'rgb/focus': self.focus, 'segmentation/labels': self.labels,
                   **self.scene}
        for name, message in good.items():
            for stamp in (LAST_STAMP, rospy.Time(0)):
                message.header.stamp = stamp
                talkers[name].say(message)
            self.assert_diagnosed(ERROR, self.topic(name), 'stamp 4294967295 s 950000000 ns is impossible')
        stamp = next(STAMPS)
        self.send_scene(stamp)
        self.send(stamp)
        self.assert_as_files(stamp, INDICES, MIDDLE)


class JumpTest(FusionTest):
    def test_frames_that_wait_for_their_focus_do_not_disturb_those_after_a_jump(self):
        self.expect_labels()
        stamp = next(STAMPS)
        self.send_labels(stamp + 50)
        frames = [colour_message(picture('both'), stamp + 50 + index * DEPTH_PERIOD) for index in range(64)]
        self.deliver(self.node, *((self.image, frame) for frame in frames))
        self.deliver_labels(stamp)
        self.assert_fused(self.send_bracket(stamp))


class LateFrames(RefinedTest):
    """Frames are stamped at the shutter and come after download, while depth goes on."""

    def send_depth(self, begin, end):
        stamps = [begin + step * DEPTH_PERIOD for step in range(int((end - begin) / DEPTH_PERIOD))]
        for first in range(0, len(stamps), AT_ONCE):
            self.send_scene(*stamps[first:first + AT_ONCE])


class AnnouncedLateFramesTest(LateFrames):
    def test_what_an_announced_bracket_needs_is_kept(self):
        self.reconfigure(label_timeout=5.0)
        self.expect_scene()
        for late in (0.125, 1.5, 3, 5, 20):
            stamp, bracket = next(STAMPS), next(BRACKET_IDS)
            self.send_depth(stamp - 0.5, stamp + DEPTH_PERIOD)
            for index, frame in enumerate(FRAMES):
                focus = FocusFrame(bracket_id=bracket, index=index, count=len(FRAMES), focus_distance=frame[0])
                focus.header.stamp, focus.header.frame_id = rospy.Time.from_sec(stamp + index * PERIOD), 'color'
                self.focus.say(focus)
            self.send_depth(stamp + DEPTH_PERIOD, stamp + late)
            for index in INDICES:
                self.image.say(colour_message(pixels(index), stamp + index * PERIOD))
            report = self.assert_as_files(stamp, INDICES, MIDDLE)
            self.assertEqual([report.label_stamp.to_sec(), list(report.notes)], [stamp, []])

    def test_labels_that_are_too_old_are_told_of(self):
        self.reconfigure(label_timeout=0.25)
        self.expect_scene()
        stamp = next(STAMPS)
        self.send_depth(stamp - 3.5, stamp - 3.5 + 2 * DEPTH_PERIOD)
        self.send(stamp)
        report = self.report(stamp + MIDDLE * PERIOD)
        self.assert_noted(report, 'sharpness alone', '3.5 s older', 'label_max_age (1 s)')


class PlainLateFramesTest(LateFrames):
    RIG = '/plain'

    def test_without_focus_the_whole_time_that_frames_were_late_stays_covered(self):
        self.reconfigure(label_timeout=5.0, bracket_size=len(FRAMES))
        self.expect_scene()
        for late in (20, 5, 3, 1.5, 0.125):
            stamp = next(STAMPS)
            self.send_depth(stamp - 0.5, stamp + late)
            for index in INDICES:
                self.image.say(colour_message(pixels(index), stamp + index * PERIOD))
            report = self.assert_as_files(stamp, INDICES, MIDDLE, focus=False)
            self.assertLessEqual(stamp - report.label_stamp.to_sec(), 1.0)  # label_max_age
            self.assertFalse([note for note in report.notes if 'label' in note])


class SilenceTest(FusionTest):
    def send_behind_one_that_waits(self, stamp, *brackets):
        """The first frame waits for labels, the others for the first one."""
        self.reconfigure(label_timeout=60.0)
        messages = [message for bracket in brackets for message in bracket]
        for first in range(0, len(messages), 2 * AT_ONCE):
            self.deliver(self.node, *messages[first:first + 2 * AT_ONCE])
        for n in range(len(brackets)):
            self.send_labels(stamp + 10 * n)

    def test_every_bracket_is_reported_while_labels_are_silent(self):
        self.reconfigure(label_timeout=2.0)
        self.expect_labels()
        stamp, count = next(STAMPS), 150  # while the first one waits for labels: the dropped ones are reported all at once
        wanted = set(itertools.islice(BRACKET_IDS, count))
        for some in np.array_split(sorted(wanted), count // 10):
            self.deliver(self.node, *(part for number in some.tolist() for part in
                                      self.bracket_of(stamp + number - min(wanted), bracket_id=number)))
        reports = lambda: {r.bracket_id: r for r in self.outputs['report'].messages}
        self.assertTrue(wait_until(lambda: wanted <= set(reports())), wanted - set(reports()))
        for report in (reports()[number] for number in wanted):
            self.assertEqual(report.frames_seen + report.frames_missing, 3)
            self.assert_noted(report, 'none ever came') if report.frames_used else self.assert_noted(report, 'dropped')
        self.assert_next_bracket_is_good(stamp + count + 1)

    def test_frames_that_were_dropped_at_the_end_of_an_open_sweep_count(self):
        self.expect_labels()
        stamp = next(STAMPS)
        self.send_behind_one_that_waits(stamp, self.bracket_of(stamp, count=0),
                                        self.bracket_of(stamp + 10, ['none'] * 2 * AT_ONCE))
        self.assert_noted(self.report(stamp), 'only 1 of 3 frames were used')

    def assert_counts(self, *brackets):
        """brackets: (length, frames used, frames missing), behind a first one that waits for labels."""
        self.expect_labels()
        stamp, ids = next(STAMPS), list(itertools.islice(BRACKET_IDS, len(brackets)))
        self.send_behind_one_that_waits(stamp, *(
            self.bracket_of(stamp + 10 * n, (['near', 'far'] * length)[:length], bracket_id=ids[n])
            for n, (length, *_) in enumerate(brackets)))
        reports = lambda: [(r.bracket_id, r.frames_used, r.frames_missing) for r in self.outputs['report'].messages
                           if r.bracket_id in ids]
        self.assertTrue(wait_until(lambda: len(reports()) >= len(ids)), reports())
        self.assertEqual(reports(), [(number, *counts) for number, (_, *counts) in zip(ids, brackets)])

    def test_a_whole_bracket_is_dropped_so_that_others_are_fused_whole(self):
        self.assert_counts((3, 3, 0), (AT_ONCE, 0, AT_ONCE), (AT_ONCE, AT_ONCE, 0))

    def test_a_dropped_bracket_has_nothing_of_the_scene_of_the_one_before(self):
        self.expect_labels()
        depth, stamp = self.talk(self.topic('depth_registered/image'), Image), next(STAMPS)
        self.deliver(self.node, (depth, image_message(picture('both'), stamp, 'bgr8', 'color')))
        self.send_behind_one_that_waits(stamp, *(self.bracket_of(stamp + 10 * n, ['near'] * length)
                                                 for n, length in enumerate((3, AT_ONCE, AT_ONCE))))
        fused, dropped = self.report(stamp + PERIOD), self.report(stamp + 10)
        self.assertEqual([fused.frames_used, dropped.frames_used], [3, 0])
        self.assert_noted(fused, 'the result has no depth')
        self.assertFalse([note for note in dropped.notes if 'depth' in note], dropped.notes)

    def test_the_rest_of_a_bracket_is_dropped_before_a_whole_one(self):
        """Of the long one the first frames do not fit, nor those of the bracket before it that wait."""
        self.assert_counts((3, 1, 2), (2 * AT_ONCE, 0, 2 * AT_ONCE), (20, 20, 0), (AT_ONCE, AT_ONCE, 0))

    def test_a_camera_that_shoots_on_request_may_be_silent_between_brackets(self):
        """The other rig, without rgb/focus, tells how long is too long."""
        self.assert_next_bracket_is_good(next(STAMPS))
        self.listen('/plain/all_in_focus/report', FusionReport)
        self.talk('/plain/rgb/image', Image).say(colour_message(picture('both'), next(STAMPS)))
        self.diagnostics.wait('plain/fusion', lambda s: s.level == WARN and '/plain/rgb/image' in s.message)
        self.assertNotIn(self.topic('rgb/image'), self.diagnostics.next(self.node).message)


if __name__ == '__main__':
    run_tests(__file__)
