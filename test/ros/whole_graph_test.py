#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From raw depth and colour frames to the fused image through all three nodes, with good input and with bad."""
import numpy as np
from tf2_msgs.msg import TFMessage

from depth_testing import ERROR, HEIGHT, WARN, WIDTH, camera_info, pixels_of, run_tests, transform
from rig_testing import OPTICS, STAMPS, RigTest


class OpticsTest(RigTest):
    def fuse(self):
        """Segment table and report of one bracket."""
        stamp = next(STAMPS)
        self.send_depth(stamp)
        table = self.segments.at(stamp)
        self.assertIsNotNone(table)
        return table, self.report(self.send_bracket(stamp))

    def test_changed_optics_reach_labels_segments_and_report(self):
        # The planes lie 2/3 dioptre apart; each change lets 1/H = F CoC / f^2 exceed that.
        for change in ({'focal_length_mm': 8.0}, {'aperture': 32.0}, {'circle_of_confusion_mm': 0.15}):
            for optics, labels in ((OPTICS, [1, 2]), ({**OPTICS, **change}, [1])):
                self.optics.update_configuration(optics)
                table, report = self.fuse()
                self.assertEqual([s.label for s in table.segments], labels, optics)
                self.assertEqual(np.unique(pixels_of(self.labels.at(table.header.stamp.to_sec()))).tolist(), labels)
                self.assertEqual([s.label for s in report.segments], labels)
                for name, value in optics.items():
                    self.assertAlmostEqual(getattr(table.optics, name), value)
                    self.assertAlmostEqual(getattr(report.optics, name), value)

    def test_everything_is_well(self):
        report = self.assert_good_bracket_is_fused()
        self.assertEqual([report.mode, report.frames_used, list(report.notes)], ['paper', 3, []])

    def test_everything_is_well_in_mode_refined(self):
        self.reconfigure(mode='refined')
        _, report = self.fuse()
        self.assertEqual([report.mode, report.frames_used, report.reference], ['refined', 3, 1])
        self.assertEqual(list(report.notes), ['no focus distances: depth and lens data are not used'])
        self.assertEqual([(s.label, s.frame) for s in report.segments], [(1, 1), (2, 2)])


class BadInputTest(RigTest):
    def setUp(self):
        super().setUp()
        self.reconfigure(label_timeout=0.5)

    def assert_fused_without_labels(self, stamp):
        self.assert_fused_by_sharpness(self.send_bracket(stamp))
        self.assert_diagnosed(WARN, 'sharpness alone')

    def test_depth_of_a_wrong_type(self):
        stamp = next(STAMPS)
        self.send_depth(stamp, np.zeros((HEIGHT, WIDTH, 3), np.uint8), 'rgb8')
        self.assert_diagnosed(ERROR, 'rgb8', '/rig/depth/image_raw', node='depth_preprocess')
        self.assert_fused_without_labels(stamp)
        self.assert_good_bracket_is_fused()

    def test_depth_without_a_value(self):
        for pixels, encoding in ((np.zeros((HEIGHT, WIDTH), np.uint16), '16UC1'),
                                 (np.full((HEIGHT, WIDTH), np.nan, np.float32), '32FC1')):
            stamp = next(STAMPS)
            self.send_depth(stamp, pixels, encoding)
            report = self.report(self.send_bracket(stamp, ('none', 'both', 'far')))
            self.assertEqual([(s.label, s.frame) for s in report.segments], [(0, 1)])  # all of it is unknown
            for node in ('depth_preprocess', 'segmenter'):
                self.assert_diagnosed(WARN, 'not one pixel', node=node)
            self.assert_good_bracket_is_fused()

    def test_uncalibrated_cameras(self):
        for name, frame in (('depth', 'depth'), ('rgb', 'color')):
            stamp = next(STAMPS)
            self.send_depth(stamp, **{name: camera_info(stamp, frame, 0.0)})
            self.assert_diagnosed(ERROR, f'/rig/{name}/camera_info', 'not calibrated', node='depth_preprocess')
            self.assert_fused_without_labels(stamp)
            self.assert_good_bracket_is_fused()

    def test_a_transform_that_comes_late(self):
        self.reconfigure(label_timeout=30.0)
        stamp = next(STAMPS)
        self.send_depth(stamp, frame='latecomer')
        middle = self.send_bracket(stamp)
        self.assert_diagnosed(ERROR, 'latecomer', 'color', 'static_transform_publisher', node='depth_preprocess')
        self.transforms.publish(TFMessage([transform('depth'), transform('latecomer')]))
        self.assertTrue(self.report(middle).has_labels)
        self.assert_good_bracket_is_fused()

    def test_a_transform_that_never_comes(self):
        stamp = next(STAMPS)
        self.send_depth(stamp, frame='nowhere')
        self.assert_fused_without_labels(stamp)
        self.assert_diagnosed(ERROR, 'nowhere', 'color', node='depth_preprocess')
        self.assert_good_bracket_is_fused()


if __name__ == '__main__':
    run_tests(__file__)
