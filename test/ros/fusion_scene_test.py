#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mode refined: what belongs to the scene of a bracket is waited for, but can be done without."""
import numpy as np
import rospy

from depth_testing import HEIGHT, WARN, WIDTH, camera_info, image_message, run_tests, two_planes
from fusion_testing import BRACKET_IDS, PERIOD, array_of, colour_message
from process_testing import Talkative
from refined_testing import FRAMES, INDICES, LENS, MIDDLE, STAMPS, RefinedTest, fused_by_files, pixels


class SceneTest(RefinedTest):
    def assert_fused_without(self, stamp, *words):
        """By pixels, with labels, and with one note about what is missing."""
        report = self.report(stamp + MIDDLE * PERIOD)
        self.assertEqual([report.mode, report.has_labels, report.frames_used], ['refined', True, len(FRAMES)])
        self.assertEqual(len(report.notes), 1, report.notes)
        self.assert_noted(report, *words)

    def test_what_does_not_come_is_done_without(self):
        parts = ['depth_registered/image', 'depth_registered/image_raw', 'rgb/camera_info', 'rgb/optics']
        for part, consequence in (('rgb/camera_info', 'not used'), ('depth_registered/image_raw', 'counts as measured')):
            self.expect_scene(*[name for name in parts if name != part])
            self.assert_fused_without(self.fuse(), f'no {part} in time', consequence)
            self.assert_diagnosed(WARN, f'no {part} in time', consequence)
            for talker in self.scene.values():
                talker.publisher.unregister()
                self.talkers.remove(talker)
            self.scene = {}

    def test_what_is_published_is_waited_for(self):
        self.expect_scene()
        for late in ('rgb/camera_info', 'depth_registered/image', 'depth_registered/image_raw'):  # the first one is kept
            stamp = next(STAMPS)
            self.send_labels(stamp)
            for name in self.scene:
                if name != late:
                    self.send_part(name, stamp)
            self.send(stamp)
            self.assertIsNone(self.processed.at(stamp, timeout=0.3))
            self.send_part(late, stamp)
            self.assertEqual(list(self.assert_as_files(stamp, INDICES, MIDDLE).notes), [])

    def test_nothing_is_waited_for_longer_than_the_timeout(self):
        self.reconfigure(label_timeout=0.25)
        self.expect_scene()
        self.assert_as_files(self.fuse(), INDICES, MIDDLE)
        stamp = next(STAMPS)
        self.deliver(self.node, self.part_of('depth_registered/image', stamp), self.labels_of(stamp))
        self.send(stamp)
        self.assert_fused_without(stamp, 'no depth_registered/image_raw in time')
        self.assert_as_files(self.fuse(), INDICES, MIDDLE)

    def test_a_depth_image_that_was_lost_is_not_waited_for(self):
        self.expect_scene()
        stamp = next(STAMPS)
        self.deliver(self.node, *(self.part_of(name, stamp + (0.25 if name == 'depth_registered/image' else 0))
                                  for name in self.scene), self.labels_of(stamp))
        self.send(stamp)
        report = self.report(stamp + MIDDLE * PERIOD)
        self.assertEqual([report.sharpness_alone, report.has_labels, report.frames_used], [True, False, len(FRAMES)])
        self.assert_noted(report, 'no depth_registered/image in time', 'sharpness alone')

    def test_broken_parts_are_left_out(self):
        self.expect_scene()
        for name, message, words in (
                ('depth_registered/image', image_message(two_planes(), 0, 'rgb8', 'color'), ('encoding "rgb8"', 'not used')),
                ('depth_registered/image_raw', image_message(np.ascontiguousarray(two_planes()[::2]), 0, '16UC1', 'color'),
                 ('before its holes were filled is 64x24', 'counts as measured')),
                ('rgb/camera_info', camera_info(0, 'color', 0.0), ('rgb/camera_info', 'not calibrated', 'not used'))):
            stamp = next(STAMPS)
            message.header.stamp = rospy.Time.from_sec(stamp)
            self.deliver(self.node, *((self.scene[part], message) if part == name else self.part_of(part, stamp)
                                      for part in self.scene), self.labels_of(stamp))
            self.send(stamp)
            self.assert_fused_without(stamp, *words)
        self.assert_as_files(self.fuse(), INDICES, MIDDLE)

    def assert_pixels_of_files(self, stamp, **options):
        for name, wanted in fused_by_files(INDICES, MIDDLE, **options).items():
            np.testing.assert_array_equal(array_of(self.outputs[name].at(stamp + MIDDLE * PERIOD)), wanted, name)

    def test_without_labels_depth_decides_all_the_same(self):
        """The segmenter is dead, or slow: nobody waits for it."""
        self.expect_scene()
        stamp = next(STAMPS)
        self.deliver(self.node, *(self.part_of(name, stamp) for name in self.scene))
        self.send(stamp)
        report = self.report(stamp + MIDDLE * PERIOD)
        self.assertEqual([report.mode, report.has_labels, list(report.notes)], ['refined', False, []])
        self.assert_pixels_of_files(stamp)

    def test_labels_that_come_during_the_bracket_join_the_report(self):
        self.expect_scene()
        stamp, bracket_id = next(STAMPS), next(BRACKET_IDS)
        self.deliver(self.node, *(self.part_of(name, stamp) for name in self.scene))
        self.send(stamp, indices=INDICES[:-1], bracket_id=bracket_id)
        self.acknowledged(stamp + 3 * PERIOD)
        self.deliver_labels(stamp)
        self.send(stamp, indices=INDICES[-1:], bracket_id=bracket_id)
        self.assert_as_files(stamp, INDICES, MIDDLE)

    def test_a_second_publisher_of_the_lens_is_told_of(self):
        self.expect_scene()
        self.fuse()
        late = Talkative(['rostopic', 'pub', self.topic('rgb/optics'), 'all_in_focus/Optics', '50.0', '2.0', '0.03'])
        self.addCleanup(late.stop)
        self.assert_diagnosed(WARN, 'has several publishers')

    def test_a_lens_that_is_corrected_gives_the_right_pixels(self):
        """Where the lens of the calibration is unknown, it is the present one: the pixel pitch follows it."""
        images = []
        for focal_length_mm in (24.0, 35.0):
            self.lens = (focal_length_mm, 2.0, 0.019)
            stamp = self.fuse()
            self.assertEqual(self.report(stamp + MIDDLE * PERIOD).optics.focal_length_mm, focal_length_mm)
            self.assert_pixels_of_files(stamp, lens=self.lens)
            images.append(array_of(self.outputs['image'].at(stamp + MIDDLE * PERIOD)))
        self.assertGreater(np.abs(images[0].astype(int) - images[1]).max(), 0, 'the test would not see another lens')

    def test_a_scene_of_another_shape_is_not_used(self):
        """3:2 frames with depth and labels of 4:3: fused by sharpness alone, or restored from the frames alone."""
        self.expect_scene()
        for mode in ('refined', 'restored', 'paper'):
            self.reconfigure(mode=mode)
            stamp = next(STAMPS)
            self.deliver_labels(stamp) if mode == 'paper' else self.send_scene(stamp)
            cropped = {i: lambda at, i=i: colour_message(np.ascontiguousarray(pixels(i)[:42]), at) for i in INDICES}
            self.send(stamp, replaced=cropped)
            report = self.report(stamp + MIDDLE * PERIOD)
            self.assertEqual([report.frames_used, report.has_labels], [len(FRAMES), False])
            self.assertEqual(report.sharpness_alone, mode != 'restored')
            self.assert_noted(report, 'label image refused', '64x48', 'for frames of 64x42', 'not the same picture')
            self.assert_diagnosed(WARN, 'not the same picture')

    def test_binned_frames_with_a_scene_that_is_not_and_the_other_way_round(self):
        self.expect_scene()
        for binned, words in ((True, ('depth refused', '64x48 for frames of 32x48')),
                              (False, ('calibration of the colour camera refused', '32x48 for frames of 64x48'))):
            stamp = next(STAMPS)
            self.send_scene(stamp)
            info = camera_info(stamp, 'color', self.focal_px)
            info.binning_x, info.binning_y = 2, 1
            self.deliver(self.node, (self.scene['rgb/camera_info'], info))
            columns = np.s_[:, ::2 if binned else 1]
            frames = {i: lambda at, i=i: colour_message(np.ascontiguousarray(pixels(i)[columns]), at) for i in INDICES}
            self.send(stamp, replaced=frames)
            report = self.report(stamp + MIDDLE * PERIOD)
            self.assertEqual([report.frames_used, report.frames_rejected], [len(FRAMES), 0], report.notes)
            self.assert_noted(report, *words)
        self.assert_as_files(self.fuse(), INDICES, MIDDLE)

    def test_a_region_of_interest_of_another_picture_is_not_used(self):
        self.expect_scene()
        stamp = next(STAMPS)
        self.send_scene(stamp)
        info = camera_info(stamp, 'color')
        info.roi.width, info.roi.height = WIDTH // 2, HEIGHT // 2
        self.deliver(self.node, (self.scene['rgb/camera_info'], info))
        self.send(stamp)
        report = self.report(stamp + MIDDLE * PERIOD)
        self.assertEqual([report.sharpness_alone, report.frames_used, report.has_labels], [True, len(FRAMES), False])
        self.assert_noted(report, 'region of interest gives images of 32x24, but they have 64x48')
        self.assert_as_files(self.fuse(), INDICES, MIDDLE)

    def test_focus_distances(self):
        for distance, words in ((float('nan'), ['no focus distances', 'used']), (0.0, ['24 mm', 'at 0 m']), (float('inf'), [])):
            stamp = self.fuse(focus_distance=distance)
            report = self.report(stamp + MIDDLE * PERIOD)
            self.assertEqual([report.mode, report.frames_used], ['refined', len(FRAMES)])
            if words:
                self.assert_noted(report, *words)
            self.assertEqual(any('no focus distances' in note for note in report.notes), bool(words))

    def test_optics_and_depth_that_are_most_likely_a_mistake(self):
        """In the words of fuse_stack. The camera's sensor is 3.07 mm wide."""
        self.expect_scene()
        stamp = next(STAMPS)
        self.lens = (24.0, 4.0, 2.0)
        self.send_scene(stamp)
        self.send(stamp)
        words = 'the circle of confusion, 2 mm, is over a fiftieth of the sensor, which is 3.07 mm wide'
        self.assert_noted(self.report(stamp + MIDDLE * PERIOD), words)
        self.assert_diagnosed(WARN, words)

        self.lens = LENS
        boards = np.full((HEIGHT, WIDTH), 3000, np.uint16)
        for number, (x, y, width, height) in enumerate([(4, 6, 9, 30), (19, 2, 6, 20), (30, 24, 11, 18)]):
            boards[y:y + height, x:x + width] = 900 + 300 * number
        light = np.repeat((boards // 20).astype(np.uint8)[..., None], 3, axis=2)
        stamp = next(STAMPS)
        mirrored = image_message(np.ascontiguousarray(boards[:, ::-1]), stamp, '16UC1', 'color')
        self.deliver(self.node, *(self.part_of(name, stamp) if name.startswith('rgb') else (self.scene[name], mirrored)
                                  for name in self.scene), self.labels_of(stamp))
        self.send(stamp, replaced={index: lambda at: colour_message(light, at) for index in INDICES})
        words = 'fit the picture better when it is mirrored: turn off mirroring'
        self.assert_noted(self.report(stamp + MIDDLE * PERIOD), words)
        self.assert_diagnosed(WARN, words)
        self.assert_as_files(self.fuse(), INDICES, MIDDLE)


if __name__ == '__main__':
    run_tests(__file__)
