#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which label image the fusion takes, how long it waits for one, and what it does with bad input."""
import itertools

import numpy as np
import rospy
from sensor_msgs.msg import Image

from depth_testing import ERROR, HEIGHT, WARN, WIDTH, image_message, run_tests
from fusion_testing import OUTPUTS, PERIOD, FusionTest, array_of, colour_message, picture, regions, scene

STAMPS = itertools.count(100000, 10)


class LabelsTest(FusionTest):
    def assert_labels_used(self, stamp, label_stamp):
        self.assertEqual(self.assert_fused(stamp).label_stamp, rospy.Time.from_sec(label_stamp))

    def test_frames_wait_for_a_slower_segmenter(self):
        self.expect_labels()
        stamp = next(STAMPS)
        self.send_labels(stamp - 0.5, 3 - regions())
        middle = self.send_bracket(stamp)
        self.assertIsNone(self.processed.at(stamp, timeout=0.3))
        self.send_labels(stamp - 0.25)
        self.assertIsNone(self.processed.at(stamp, timeout=0.3))  # a better one may come
        self.send_labels(stamp + 0.25, 3 - regions())
        self.assert_labels_used(middle, stamp - 0.25)
        for index in range(3):
            self.acknowledged(stamp + index * PERIOD)

    def test_a_label_image_is_used_again(self):
        self.reconfigure(label_max_age=3.0)
        self.expect_labels()
        stamp = next(STAMPS)
        for at in (stamp, stamp + 5):
            self.send_labels(at)
        for start in (stamp, stamp + 1):
            self.assert_labels_used(self.send_bracket(start), stamp)

    def test_after_the_timeout_an_older_one_will_do(self):
        self.reconfigure(label_timeout=0.25)
        self.expect_labels()
        stamp = next(STAMPS)
        self.send_labels(stamp - 0.5)
        middle = self.send_bracket(stamp)
        self.assert_labels_used(middle, stamp - 0.5)
        report = self.report(middle)
        waited = dict(zip(report.timing_names, report.timing_ms))['scene_wait']
        self.assertGreaterEqual(waited, 249)

    def test_no_label_in_time(self):
        self.reconfigure(label_timeout=0.25)
        self.expect_labels()
        stamp = next(STAMPS)
        self.assert_fused_by_sharpness(self.send_bracket(stamp))
        self.assert_diagnosed(WARN, 'no label image in time')
        self.assert_next_bracket_is_good(stamp + 1)

    def test_labels_of_another_size(self):
        self.expect_labels()
        for labels in (regions()[::2, ::2], regions().repeat(3, axis=0).repeat(3, axis=1)):
            stamp = next(STAMPS)
            self.send_labels(stamp, np.ascontiguousarray(labels))
            self.assert_fused(self.send_bracket(stamp))

    def test_unknown_depth_is_a_region_of_its_own(self):
        self.expect_labels()
        stamp, labels = next(STAMPS), regions() - 1
        self.send_labels(stamp, labels)
        report = self.report(self.send_bracket(stamp))
        self.assertEqual([(s.label, s.frame) for s in report.segments], [(0, 1), (1, 2)])

    def test_broken_labels_are_refused(self):
        self.reconfigure(label_timeout=0.25)
        self.expect_labels()
        self.send_labels(next(STAMPS), np.ones((HEIGHT, WIDTH), np.float32), '32FC1')
        self.assert_diagnosed(ERROR, '/focus/segmentation/labels', '32SC1')
        for cut in ({'data': b'\1' * 40}, {'width': 0, 'step': 0, 'data': b''}, {'step': 8, 'data': b'\1' * 8 * HEIGHT}):
            stamp = next(STAMPS)
            message = image_message(regions(), stamp, '32SC1', 'color')
            for name, value in cut.items():
                setattr(message, name, value)
            self.labels.say(message)
            self.assert_fused_by_sharpness(self.send_bracket(stamp))
        self.assert_next_bracket_is_good(stamp + 1)

    def test_negative_labels_are_refused(self):
        self.expect_labels()
        stamp = next(STAMPS)
        self.send_labels(stamp, regions() - 2)
        self.assert_noted(self.assert_fused_by_sharpness(self.send_bracket(stamp)), 'label image refused', 'negative')
        self.assert_diagnosed(WARN, 'negative')
        self.assert_next_bracket_is_good(stamp + 1)


class BadFramesTest(FusionTest):
    def setUp(self):
        super().setUp()
        self.expect_labels()

    @staticmethod
    def broken(stamp):
        """Sharper than all others, but broken."""
        good = lambda: colour_message(scene(), stamp)
        yield 'most of the bracket is 64x48', colour_message(scene()[:24, :32], stamp)
        yield '16UC1', colour_message(scene()[:, :, 0].astype(np.uint16), stamp, '16UC1')
        for what, fields in (('what', {'encoding': 'what'}), ('', {'encoding': ''}),
                             ('empty', {'width': 0, 'height': 0, 'step': 0, 'data': b''}), ('empty', {'height': 0}),
                             ('data holds', {'data': scene().tobytes()[:-1]}), ('data holds', {'height': 2 ** 32 - 1}),
                             ('', {'step': WIDTH}), ('', {'width': 2 * WIDTH})):
            message = good()
            for name, value in fields.items():
                setattr(message, name, value)
            yield what, message

    def test_broken_frames_are_left_out(self):
        for number, (what, _) in enumerate(self.broken(0)):
            stamp = next(STAMPS)
            message = list(self.broken(stamp + 2 * PERIOD))[number][1]
            self.send_labels(stamp)
            middle = self.send_bracket(stamp, ('near', 'none', message, 'none', 'far'))
            for index in range(5):
                self.acknowledged(stamp + index * PERIOD)
            report = self.assert_fused(stamp + PERIOD, near=0, far=4)  # 1 is as near to the middle as 3
            self.assertIsNone(self.outputs['report'].at(middle, timeout=0))
            self.assertEqual([report.frames_seen, report.frames_used, report.frames_rejected, report.frames_missing],
                             [5, 4, 1, 0])
            self.assert_noted(report, 'frame 2 rejected', what)
        self.assert_diagnosed(ERROR, '')
        self.assert_next_bracket_is_good(stamp + 1)
        self.diagnostics.wait(self.node, lambda s: s.level < ERROR)  # no data on what this test does not send is a warning

    def test_a_broken_first_frame(self):
        stamp = next(STAMPS)
        self.send_labels(stamp)
        broken = colour_message(scene(), stamp)
        broken.data = b''
        self.send_bracket(stamp, (broken, 'near', 'far', 'none'))
        report = self.assert_fused(stamp + 2 * PERIOD)
        self.assertEqual([report.frames_used, report.frames_rejected], [3, 1])

    def test_a_bracket_of_another_size_than_the_one_before(self):
        for pixels in (scene()[:24, :32], scene().repeat(2, axis=0).repeat(2, axis=1), scene()):
            stamp = next(STAMPS)
            self.send_labels(stamp)
            middle = self.send_bracket(stamp, [colour_message(pixels, stamp + i * PERIOD) for i in range(3)])
            self.assertEqual(self.report(middle).frames_used, 3)
            np.testing.assert_array_equal(array_of(self.outputs['image'].at(middle)), pixels)

    def test_not_one_frame_can_be_used(self):
        good = next(STAMPS)
        middle = self.send_good_bracket(good)
        self.assert_fused(middle)
        stamp = next(STAMPS)
        self.send_labels(stamp)
        broken = [colour_message(scene(), stamp + i * PERIOD, 'what') for i in range(3)]
        self.send_bracket(stamp, broken)
        report = self.report(stamp)
        self.assertEqual([report.frames_seen, report.frames_used, report.frames_rejected], [3, 0, 3])
        self.assert_noted(report, 'no frame could be used')
        self.assert_diagnosed(ERROR, 'what')
        for name in ('image', 'source_index'):
            self.assertIsNone(self.outputs[name].at(stamp, timeout=0.3), name)
            self.assertIsNotNone(self.listen(self.topic('all_in_focus/' + name), Image).at(middle), name)  # latched
        self.assert_next_bracket_is_good(stamp + 1)

    def test_a_transport_that_is_not_installed_is_raw(self):
        rospy.set_param(self.topic('fusion/image_transport'), 'nonsense')
        for output in self.outputs.values():
            output.close()
        self.diagnostics.wait(self.topic('fusion').lstrip('/'), lambda s: 'nobody listens' in s.message)
        self.outputs = {name: self.listen(self.topic('all_in_focus/' + name), OUTPUTS[name]) for name in self.outputs}
        self.assert_diagnosed(ERROR, "~image_transport: using raw: Unable to load plugin for transport 'nonsense'")
        self.assert_next_bracket_is_good(next(STAMPS))

    def test_colours_of_other_encodings(self):
        for encoding in ('rgb8', 'mono8'):
            stamp = next(STAMPS)
            self.send_labels(stamp)
            change = {'rgb8': lambda p: p[:, :, ::-1], 'mono8': lambda p: p[:, :, 0]}[encoding]
            frames = [colour_message(change(picture(sharp)), stamp + i * PERIOD, encoding)
                      for i, sharp in enumerate(('none', 'near', 'far'))]
            middle = self.send_bracket(stamp, frames)
            report = self.report(middle)
            self.assertEqual([(s.label, s.frame) for s in report.segments], [(1, 1), (2, 2)])
            wanted = scene() if encoding == 'rgb8' else np.repeat(scene()[:, :, :1], 3, axis=2)
            np.testing.assert_array_equal(array_of(self.outputs['image'].at(middle)), wanted)


if __name__ == '__main__':
    run_tests(__file__)
