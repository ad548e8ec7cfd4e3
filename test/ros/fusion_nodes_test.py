#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where the fusion begins and ends a bracket, and what it publishes then."""
import itertools
import math

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image

from all_in_focus.msg import FocusFrame
from depth_testing import (HEIGHT, OK, WARN, WIDTH, camera_info, image_message, pixels_of, run_tests, subscribers_of,
                           two_planes, wait_until)
from fusion_testing import BRACKET_IDS, DEFAULTS, FAR, NEAR, OUTPUTS, PERIOD, FusionTest, array_of, colour_message, scene

STAMPS = itertools.count(1000, 10)


class FocusBracketTest(FusionTest):
    """Brackets as rgb/focus says."""

    def test_count_ends_a_bracket(self):
        self.expect_labels()
        for _ in range(2):
            stamp, bracket_id = next(STAMPS), next(BRACKET_IDS)
            self.send_labels(stamp)
            report = self.assert_fused(self.send_bracket(stamp, bracket_id=bracket_id))
            self.assertEqual([report.bracket_id, report.mode, report.reference], [bracket_id, 'paper', 1])
            self.assertEqual([report.frames_seen, report.frames_used, report.frames_rejected, report.frames_missing],
                             [3, 3, 0, 0])
            self.assertEqual(report.label_stamp, rospy.Time.from_sec(stamp))
            self.assertTrue(all(s.score > 0 and 0 < s.margin <= 1 for s in report.segments))
            self.assertEqual(list(report.notes), [])

    def test_a_bracket_may_lack_its_first_picture(self):
        """Also the first bracket: rgb/focus has told of its beginning."""
        self.expect_labels()
        stamp = next(STAMPS)
        self.send_labels(stamp + PERIOD)
        for talker, message in list(self.bracket_of(stamp))[1:]:
            talker.say(message)
        report = self.assert_fused(stamp + PERIOD)
        self.assertEqual([report.frames_used, report.frames_missing], [2, 1])

    def test_a_new_id_closes_the_bracket_before_and_missing_frames_are_reported(self):
        self.expect_labels()
        stamp, bracket_id = next(STAMPS), next(BRACKET_IDS)
        self.send_labels(stamp)
        for index, sharp in ((0, 'none'), (1, 'near'), (4, 'far')):
            self.send_frame(stamp + index * PERIOD, sharp, bracket_id=bracket_id, index=index, count=7)
        self.acknowledged(stamp + 4 * PERIOD)
        self.assertIsNone(self.outputs['report'].at(stamp + 4 * PERIOD, timeout=0))
        self.assert_next_bracket_is_good(stamp + 2)
        report = self.assert_fused(stamp + 4 * PERIOD, near=1, far=4)  # the nearest to the middle one, 3
        self.assertEqual([report.frames_used, report.frames_missing, report.reference], [3, 4, 4])
        self.assert_noted(report, '4 frames never came')
        self.assert_diagnosed(WARN, f'bracket {bracket_id}', '4 frames never came')

    def test_frames_that_come_twice_or_late_are_refused(self):
        stamp, bracket = next(STAMPS), {'bracket_id': next(BRACKET_IDS), 'count': 5}
        stamps = [stamp + i * PERIOD for i in range(8)]
        for at, (index, sharp) in zip(stamps, ((0, 'none'), (1, 'near'), (1, 'both'), (3, 'far'), (2, 'both'), (4, 'none'),
                                               (4, 'both'), (2, 'both'))):
            self.send_frame(at, sharp, index=index, **bracket)
            self.acknowledged(at)
            if at == stamps[2]:
                self.assert_diagnosed(WARN, 'frame 1 came twice or too late')
        report = self.assert_fused_by_sharpness(stamps[1], near=1, far=3)  # frame 2 was late: 1 is as near to the middle
        self.assertEqual([report.frames_used, report.frames_missing], [4, 1])
        self.assert_diagnosed(WARN, 'is finished already')
        self.assertIsNotNone(self.report(self.send_bracket(stamp + 5)))
        self.assertEqual(len([r for r in self.outputs['report'].messages if r.bracket_id == bracket['bracket_id']]), 1)

    def test_who_starts_listening_in_mid_bracket_gets_the_next_one(self):
        stamp, cut, whole = next(STAMPS), next(BRACKET_IDS), next(BRACKET_IDS)
        for index in (1, 2):
            self.send_frame(stamp + index * PERIOD, 'both', bracket_id=cut, index=index, count=3)
            self.acknowledged(stamp + index * PERIOD)
        self.report(self.send_bracket(stamp + 1, bracket_id=whole))
        self.assertEqual([r.bracket_id for r in self.outputs['report'].messages if r.bracket_id >= cut], [whole])

    def test_frames_without_focus_are_told_of(self):
        stamp = next(STAMPS)
        self.send_frame(stamp, 'both')
        report = self.assert_fused(self.send_good_bracket(stamp + 1))
        self.assertEqual([report.frames_used, report.frames_missing], [3, 0])
        self.acknowledged(stamp)
        self.assert_diagnosed(WARN, 'without a rgb/focus message')

    def test_a_count_beyond_all_reason_does_no_harm(self):
        for count in (65536, 2 ** 31 - 1, 2 ** 32 - 1):
            stamp = next(STAMPS)
            self.send_bracket(stamp, count=count)
            self.acknowledged(stamp + 2 * PERIOD)
            self.assertTrue(self.finish().success)
            self.assertEqual(self.report(stamp + 2 * PERIOD).frames_used, 3)
        self.assertEqual(self.report(self.send_bracket(next(STAMPS))).frames_used, 3)

    def test_sliding_publishes_after_every_frame(self):
        self.reconfigure(bracket_mode='sliding')
        self.expect_labels()
        stamp, bracket_id = next(STAMPS), next(BRACKET_IDS)
        self.send_labels(stamp)
        for index, sharp in enumerate(('none', 'near', 'far')):
            self.send_frame(stamp + index * PERIOD, sharp, bracket_id=bracket_id, index=index, last=index == 2)
        reports = lambda: [r for r in self.outputs['report'].messages if r.bracket_id == bracket_id]
        self.assertTrue(wait_until(lambda: len(reports()) == 3))
        self.assertEqual([r.frames_used for r in reports()], [1, 2, 3])
        self.assertEqual([[s.frame for s in r.segments] for r in reports()], [[0, 0], [1, 0], [1, 2]])
        self.assertTrue(wait_until(lambda: np.array_equal(array_of(self.outputs['image'].messages[-1]), scene())))

    def test_the_reference_can_be_chosen(self):
        self.reconfigure(reference=2)
        stamp = next(STAMPS)
        self.send_bracket(stamp)
        self.assertEqual(self.report(stamp + 2 * PERIOD).reference, 2)

    def test_impossible_values_are_repaired_and_shown(self):
        good = dict(DEFAULTS, reference=3, max_held_frames=7, bracket_size=4, bracket_gap=2.5, label_max_age=0.5,
                    label_timeout=3.0)
        self.reconfigure(**good)
        wrongs = [(wrong, good) for wrong in (
            {'mode': 'best'}, {'max_held_frames': -1}, {'bracket_mode': 'none'}, {'bracket_size': -1}, {'bracket_gap': -1.0},
            {'bracket_gap': math.nan}, {'label_max_age': -0.5}, {'label_timeout': math.nan}, {'reference': -7})]
        wrongs += [({name: math.inf}, {**good, name: 3600.0}) for name in ('bracket_gap', 'label_max_age')]
        wrongs += [({name: 65535}, {**good, name: 65534}) for name in ('reference', 'bracket_size', 'max_held_frames')]
        for wrong, used in wrongs:
            shown = self.reconfigure(**{**good, **wrong})
            for name, value in used.items():
                self.assertEqual(shown[name], value, wrong)
                self.assertEqual(rospy.get_param(self.topic('fusion/' + name)), value)
        self.assert_diagnosed(WARN, 'impossible configuration')


class PlainBracketTest(FusionTest):
    """Brackets without rgb/focus."""
    RIG = '/plain'

    def send(self, stamps, frames):
        for stamp, sharp in zip(stamps, frames):
            self.send_frame(stamp, sharp)

    def test_stamps_of_another_clock_do_not_cut_brackets_short(self):
        self.reconfigure(bracket_gap=30.0)  # but the stamps are decades old
        stamp = next(STAMPS)
        for index, sharp in enumerate(('near', 'far')):
            self.send_frame(stamp + index * PERIOD, sharp)
            self.acknowledged(stamp + index * PERIOD)
            rospy.sleep(0.3)
        self.finish()
        self.assertEqual(self.assert_fused_by_sharpness(stamp, near=0, far=1).frames_used, 2)

    def test_frames_without_stamps_are_fused(self):
        for number, sharp in enumerate(('near', 'far'), 1):
            self.send_frame(0, sharp)
            self.assertTrue(wait_until(lambda: len(self.processed.messages) == number))
        self.finish()
        self.assert_fused_by_sharpness(0, near=0, far=1)

    def test_finish_answers_after_publication(self):
        stamp = next(STAMPS)
        published = lambda: int(self.finish().message.split()[0])
        before = published()
        self.assertEqual(published(), before)  # nothing was open
        self.send((stamp, stamp + PERIOD), ('near', 'far'))
        self.acknowledged(stamp + PERIOD)
        answer = self.finish()
        self.assertEqual([answer.success, answer.message], [True, f'{before + 1} brackets published'])
        self.assert_fused_by_sharpness(stamp, near=0, far=1)
        self.assertEqual(published(), before + 1)

    def test_focus_may_appear_in_mid_bracket(self):
        stamp, cut, whole = next(STAMPS), next(BRACKET_IDS), next(BRACKET_IDS)
        self.send_frame(stamp, 'both')
        self.acknowledged(stamp)
        self.focus = self.talk(self.topic('rgb/focus'), FocusFrame)
        for index in (1, 2):
            self.send_frame(stamp + index * PERIOD, 'both', bracket_id=cut, index=index, count=3)
            self.acknowledged(stamp + index * PERIOD)
        middle = self.send_bracket(stamp + 1, bracket_id=whole)
        self.assertEqual(self.assert_fused_by_sharpness(middle).frames_missing, 0)
        self.assertEqual([r.header.stamp.to_sec() for r in self.outputs['report'].messages if
                          r.header.stamp.to_sec() >= stamp], [stamp, middle])

    def test_one_frame_is_its_own_result(self):
        for kind, encoding in (('bgr8', 'bgr8'), ('rgb8', 'rgb8'), ('mono8', 'mono8')):
            stamp, pixels = next(STAMPS), scene()
            sent = pixels[:, :, 0] if encoding == 'mono8' else pixels
            self.send_frame(stamp, colour_message(sent, stamp, encoding))
            self.acknowledged(stamp)
            self.finish()
            self.assert_noted(self.report(stamp), 'only one frame')
            image = self.outputs['image'].at(stamp)
            wanted = {'bgr8': pixels, 'rgb8': pixels[:, :, ::-1], 'mono8': np.repeat(pixels[:, :, :1], 3, axis=2)}[encoding]
            self.assertEqual(image.encoding, 'bgr8')
            np.testing.assert_array_equal(array_of(image), wanted)
            self.assertFalse(array_of(self.outputs['source_index'].at(stamp)).any())


class OutputsTest(FusionTest):
    def send_depth_and_bracket(self, stamp):
        """Twice the size of the colour."""
        depth = two_planes().repeat(2, axis=0).repeat(2, axis=1)
        self.deliver(self.node, (self.depth, image_message(depth, stamp, '16UC1', 'color')),
                     (self.info, camera_info(stamp - 1, 'another')))
        self.send_labels(stamp)
        return self.send_bracket(stamp)

    def setUp(self):
        super().setUp()
        self.expect_labels()
        self.depth = self.talk(self.topic('depth_registered/image'), Image)
        self.info = self.talk(self.topic('rgb/camera_info'), CameraInfo)

    def assert_one_result(self, outputs, stamp):
        results = {name: output.at(stamp) for name, output in outputs.items()}
        for name, message in results.items():
            self.assertIsNotNone(message, name)
            self.assertEqual(message.header.frame_id, 'color', name)
        self.assertEqual([results[name].encoding for name in ('image', 'source_index', 'confidence', 'weights_color', 'depth')],
                         ['bgr8', '16UC1', 'mono8', 'rgb8', '16UC1'])
        self.assertEqual({(results[name].width, results[name].height) for name in OUTPUTS if name != 'report'},
                         {(WIDTH, HEIGHT)})
        self.assertEqual(results['camera_info'].K, tuple(camera_info(0, '').K))
        np.testing.assert_array_equal(pixels_of(results['depth']), two_planes())
        confidence = array_of(results['confidence'])
        for segment, half in zip(results['report'].segments, (NEAR, FAR)):
            self.assertEqual(segment.confidence, segment.margin)
            self.assertAlmostEqual(confidence[half].mean() / 255, segment.confidence, delta=1 / 255)
        weights = pixels_of(results['weights_color'])
        self.assertNotEqual(weights[NEAR][0, 0].tolist(), weights[FAR][0, 0].tolist())

    def test_all_outputs_carry_the_header_of_the_reference(self):
        outputs = {name: self.listen(self.topic('all_in_focus/' + name), kind) for name, kind in OUTPUTS.items()}
        self.assert_one_result(outputs, self.send_depth_and_bracket(next(STAMPS)))

    def test_late_listeners_get_the_last_result(self):
        self.send_depth_and_bracket(next(STAMPS))
        stamp = self.send_depth_and_bracket(next(STAMPS))
        for output in self.outputs.values():
            self.assertIsNotNone(output.at(stamp))
        outputs = {name: self.listen(self.topic('all_in_focus/' + name), kind) for name, kind in OUTPUTS.items()}
        self.assert_one_result(outputs, stamp)
        for output in outputs.values():
            # Once or twice: roscpp may send a new listener the last message while that still waits in its queue.
            self.assertEqual({message.header.stamp for message in output.messages}, {rospy.Time.from_sec(stamp)})

    def test_subscribes_only_while_somebody_listens(self):
        inputs = [self.topic(name) for name in ('rgb/image', 'rgb/focus', 'rgb/camera_info', 'segmentation/labels',
                                                'depth_registered/image', 'depth_registered/image_raw', 'rgb/optics')]
        for listener in self.listeners:
            listener.close()
        idle = lambda: not any(subscribers_of(topic) for topic in inputs)
        for name, kind in OUTPUTS.items():
            self.assertTrue(wait_until(idle), name)
            listener = self.listen(self.topic('all_in_focus/' + name), kind)
            self.assertTrue(wait_until(lambda: all(subscribers_of(topic) for topic in inputs)), name)
            listener.close()
        self.assertTrue(wait_until(idle))

    def test_diagnostics_count_frames(self):
        self.send_depth_and_bracket(next(STAMPS))
        self.diagnostics.wait(self.node, lambda s: s.level == OK and s.message == 'processing')

    def test_two_rigs_do_not_meet(self):
        other = PlainBracketTest()
        other.setUp()
        self.addCleanup(other.doCleanups)
        self.addCleanup(other.tearDown)
        other.expect_labels()
        other.reconfigure(bracket_size=3)
        stamp = next(STAMPS)
        for rig in (self, other):
            rig.send_labels(stamp)
        frames, bracket_id = (('near', 'far', 'none'), ('none', 'near', 'far')), next(BRACKET_IDS)
        for index in range(3):
            self.send_frame(stamp + index * PERIOD, frames[0][index], bracket_id=bracket_id, index=index, count=3)
            other.send_frame(stamp + index * PERIOD, frames[1][index])
        self.assert_fused(stamp + PERIOD, near=0, far=1)
        other.assert_fused(stamp + PERIOD, near=1, far=2)


if __name__ == '__main__':
    run_tests(__file__)
