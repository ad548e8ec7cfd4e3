#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mode refined: which frame is the reference, and what waits for it. Pixels are those of fuse_stack."""
import itertools

import numpy as np

from depth_testing import ERROR, run_tests, values_of, wait_until
from fusion_testing import BRACKET_IDS, PERIOD, array_of, colour_message
from refined_testing import FRAMES, INDICES, MIDDLE, RefinedTest, another_scene, fused_by_files, pixels


class ReferenceTest(RefinedTest):
    def test_the_reference_goes_first_the_others_in_their_order(self):
        images = []
        for parameter, reference in ((-1, MIDDLE), (0, 0), (1, 1), (4, 4), (99, 4)):
            self.reconfigure(reference=parameter)
            stamp = self.fuse()
            self.assertEqual(list(self.assert_as_files(stamp, INDICES, reference).notes), [])
            images.append(array_of(self.outputs['image'].at(stamp + reference * PERIOD)))
        for one, other in itertools.combinations(images[:-1], 2):
            # Half of what one step of brightness between the frames, 0.1, makes of their mean gray level.
            self.assertGreater(np.abs(one.astype(int) - other).mean(), 0.05 * 127, 'the test would not see another reference')

    def test_held_frames_do_not_hold_up_their_sender(self):
        bracket_id = next(BRACKET_IDS)
        stamp = self.fuse(indices=range(MIDDLE), bracket_id=bracket_id)
        for index in range(MIDDLE):
            self.acknowledged(stamp + index * PERIOD)
        self.send(stamp, range(MIDDLE, len(FRAMES)), bracket_id=bracket_id)
        self.assert_as_files(stamp, INDICES, MIDDLE)
        acknowledged = lambda index: [h.stamp.to_sec() for h in self.processed.messages].count(stamp + index * PERIOD)
        self.assertTrue(wait_until(lambda: acknowledged(INDICES[-1])))
        self.assertEqual([acknowledged(i) for i in INDICES], [1] * len(FRAMES))

    def test_no_more_frames_are_held_than_allowed(self):
        for most, reference in ((0, 0), (1, 0), (2, MIDDLE)):
            self.reconfigure(max_held_frames=most)
            report = self.assert_as_files(self.fuse(), INDICES, reference)
            self.assertEqual(len(report.notes), reference == 0)
            if reference == 0:
                self.assert_noted(report, f'at most {most} frames', 'max_held_frames', 'the first frame is the reference')

    def test_an_open_bracket_keeps_its_first_frame(self):
        stamp = self.fuse(count=0)
        self.acknowledged(stamp + INDICES[-1] * PERIOD)
        self.finish()
        self.assertEqual(list(self.assert_as_files(stamp, INDICES, 0).notes), [])

    def test_when_the_reference_is_lost_the_nearest_stands_in(self):
        for came, reference in (([0, 1, 3, 4], 1), ([0, 3, 4], 3), ([0, 1], 1), ([0], 0)):
            stamp = self.fuse(indices=came)
            self.acknowledged(stamp + came[-1] * PERIOD)
            self.finish()
            report = self.assert_as_files(stamp, came, reference)
            self.assert_noted(report, 'frame 2, is missing or was rejected', f'frame {reference} takes its place')
            self.assert_noted(report, f'{len(FRAMES) - len(came)} frames never came')

    def test_a_new_bracket_ends_one_that_waits_for_its_reference(self):
        stamp = self.fuse(indices=[0, 1])
        self.acknowledged(stamp + PERIOD)
        whole = self.fuse()
        self.assert_as_files(stamp, [0, 1], 1)
        self.assert_as_files(whole, INDICES, MIDDLE)

    def test_a_reference_that_is_refused_does_not_lose_the_bracket(self):
        for broken, what in ((lambda stamp: colour_message(pixels(MIDDLE), stamp, 'what'), 'what'),
                             (lambda stamp: colour_message(pixels(MIDDLE)[:24, :32], stamp), 'most of the bracket is 64x48')):
            stamp = self.fuse(replaced={MIDDLE: broken})
            report = self.assert_as_files(stamp, [0, 1, 3, 4], 1)
            self.assert_noted(report, 'frame 2 rejected', what)
            self.assert_noted(report, 'frame 1 takes its place')
            self.assertEqual([report.frames_seen, report.frames_rejected], [5, 1])

    def test_an_odd_middle_frame_is_not_the_reference(self):
        for odd, what in ((lambda stamp: colour_message(0 * pixels(MIDDLE), stamp), 'much darker than the others'),
                          (another_scene, 'something else than the others')):
            stamp = self.fuse(replaced={MIDDLE: odd})
            report = self.assert_as_files(stamp, [0, 1, 3, 4], 3)
            self.assert_noted(report, f'frame {MIDDLE} rejected: it', what)

    def test_few_used_frames_are_told(self):
        stamp = self.fuse(indices=[0, 1])
        self.acknowledged(stamp + PERIOD)
        self.finish()
        self.assert_noted(self.assert_as_files(stamp, [0, 1], 1), 'only 2 of 5 frames were used')

    def fuse_deep(self, factor):
        """A bracket of frames with 16 bits, with so many codes for one of 8 bits."""
        frame = lambda stamp, i: colour_message(pixels(i).astype(np.uint16) * factor, stamp, 'bgr16')
        stamp = self.fuse(replaced={i: lambda stamp, i=i: frame(stamp, i) for i in INDICES}) + MIDDLE * PERIOD
        self.assertEqual(self.report(stamp).frames_used, len(FRAMES), self.report(stamp).notes)
        image = self.outputs['image'].at(stamp)
        self.assertEqual(image.encoding, 'bgr16')
        return self.report(stamp), array_of(image) / 257

    def test_frames_of_twelve_bits(self):
        """Also after a camera of 16 bits: each bracket has its own white."""
        for factor, white in ((16, 4095), (257, 65535), (16, 4095)):
            report, image = self.fuse_deep(factor)
            error = image - fused_by_files(INDICES, MIDDLE)['image']
            self.assertLess(np.sqrt(np.mean(error ** 2)), 1, white)
            self.assertEqual([f'{white} is white' in note for note in report.notes], [True] * (white < 65535))

    def test_all_frames_of_a_bracket_have_one_white(self):
        """The first frame has codes of 10 bits only; the second, sharper one has more."""
        highest = [5 * int(pixels(i).max()) for i in INDICES]
        self.assertLess(highest[0], 1024)
        self.assertGreater(highest[1], 1023)
        _, image = self.fuse_deep(5)
        self.assertLess(np.sqrt(np.mean((16 / 5 * image - fused_by_files(INDICES, MIDDLE)['image']) ** 2)), 3)

    def test_sliding_takes_the_first_frame(self):
        self.reconfigure(bracket_mode='sliding')
        bracket_id = next(BRACKET_IDS)
        stamp = self.fuse(bracket_id=bracket_id)
        reports = lambda: [r for r in self.outputs['report'].messages if r.bracket_id == bracket_id]
        self.assertTrue(wait_until(lambda: len(reports()) == len(FRAMES)))
        self.assertEqual([r.frames_used for r in reports()], [1, 2, 3, 4, 5])
        self.assertEqual({r.header.stamp.to_sec() for r in reports()}, {stamp})
        for report in reports():
            self.assert_noted(report, 'sliding', 'the first frame is the reference, not frame 2')
        images = lambda: [m for m in self.outputs['image'].messages if m.header.stamp.to_sec() == stamp]
        self.assertTrue(wait_until(lambda: len(images()) == len(FRAMES)))
        for count in (1, 3, 5):
            np.testing.assert_array_equal(array_of(images()[count - 1]), fused_by_files(range(count), 0)['image'])

    def test_frames_that_do_not_fit_are_left_out(self):
        invalid = lambda: int(values_of(self.diagnostics.next(self.node))['invalid'])
        before = invalid()
        for rejected in (0, 1, 3, 4):  # before the reference and behind
            stamp = self.fuse(replaced={rejected: another_scene})
            report = self.assert_as_files(stamp, [i for i in INDICES if i != rejected], MIDDLE)
            self.assert_noted(report, f'frame {rejected} rejected: ')
            self.assertEqual([report.frames_seen, report.frames_rejected], [5, 1])
            self.acknowledged(stamp + rejected * PERIOD)
        self.assert_diagnosed(ERROR, 'frame 4: ', 'another scene')
        self.assertTrue(wait_until(lambda: invalid() == before + 4))


if __name__ == '__main__':
    run_tests(__file__)
