#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""depth_preprocess and segmenter on two planes: right labels, live reconfiguration, laziness, time that jumps back."""
import itertools

import numpy as np
import rospy
from dynamic_reconfigure.client import Client
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from all_in_focus.msg import FocusPlan, Optics, SegmentArray
from depth_testing import (FAR_MM, HEIGHT, NEAR_MM, TIMEOUT, WIDTH, AloneTest, GraphTest, camera_info, image_message, pixels_of,
                           run_tests, subscribers_of, two_planes, values_of, wait_until)

STAMPS = itertools.count(1000)
DEFAULTS = {'focal_length_mm': 24.0, 'aperture': 4.0, 'circle_of_confusion_mm': 0.019, 'dof_rule': 'paper',
            'min_region_size': 10}


class SegmenterTest(AloneTest):
    def setUp(self):
        super().setUp()
        self.client = Client('/alone/segmenter', timeout=TIMEOUT)
        self.client.update_configuration(DEFAULTS)

    def cut(self, depth=None, encoding='16UC1', stamp=None):
        stamp = next(STAMPS) if stamp is None else stamp
        self.depth.say(image_message(two_planes() if depth is None else depth, stamp, encoding, 'color'))
        labels, segments = self.labels.at(stamp), self.segments.at(stamp)
        self.assertIsNotNone(labels)
        self.assertIsNotNone(segments)
        self.assertEqual(labels.encoding, '32SC1')
        self.assertEqual([labels.header.frame_id, segments.header.frame_id], ['color', 'color'])
        return pixels_of(labels), segments

    def test_two_planes_are_two_regions_from_near_to_far(self):
        labels, array = self.cut()
        np.testing.assert_array_equal(labels, np.where(two_planes() == NEAR_MM, 1, 2))
        self.assertEqual([s.label for s in array.segments], [1, 2])
        self.assertEqual([s.area for s in array.segments], [WIDTH * HEIGHT // 2] * 2)
        np.testing.assert_allclose([s.depth_median for s in array.segments], [1.0, 3.0], rtol=1e-6)
        np.testing.assert_allclose([s.focus_distance for s in array.segments], [1.0, 3.0], rtol=1e-6)
        hyperfocal_m = 24.0 ** 2 / (4.0 * 0.019) / 1000
        self.assertAlmostEqual(array.segments[0].max_dof, 1 / (hyperfocal_m - 1), places=5)
        self.assertTrue(all(s.fits and s.diff == 0 for s in array.segments))
        self.assertEqual([array.unknown_area, array.dof_rule], [0, 'paper'])
        self.assertAlmostEqual(array.optics.focal_length_mm, 24.0)

    def test_metres_and_unknown_depth(self):
        depth = two_planes().astype(np.float32) / 1000
        depth[:4], depth[4:8], depth[8:10], depth[10:12] = np.nan, np.inf, -1, 100
        labels, array = self.cut(depth, '32FC1')
        self.assertTrue((labels[:12] == 0).all())
        np.testing.assert_array_equal(labels[12:], np.where(two_planes() == NEAR_MM, 1, 2)[12:])
        self.assertEqual(array.unknown_area, 12 * WIDTH)

    def test_optics_take_effect_with_the_next_label_image(self):
        # The planes lie 2/3 dioptre apart; each change lets 1/H = F CoC / f^2 exceed that.
        for change in ({'aperture': 32.0}, {'focal_length_mm': 8.0}, {'circle_of_confusion_mm': 0.15}):
            self.assertEqual(len(self.cut()[1].segments), 2)
            self.client.update_configuration(change)
            labels, array = self.cut()
            self.assertEqual([len(array.segments), labels.min(), labels.max()], [1, 1, 1], change)
            for name, value in change.items():
                self.assertEqual(getattr(array.optics, name), value)
            self.client.update_configuration(DEFAULTS)

    def test_dof_rule_is_used_and_reported(self):
        self.client.update_configuration({'aperture': 12.0})  # 0.4 dioptre, and twice that
        self.assertEqual(len(self.cut()[1].segments), 2)
        self.client.update_configuration({'dof_rule': 'full'})
        array = self.cut()[1]
        self.assertEqual([len(array.segments), array.dof_rule], [1, 'full'])

    def test_impossible_optics_are_repaired_and_shown(self):
        self.client.update_configuration({'aperture': 5.6})
        for wrong in ({'aperture': 0.0}, {'aperture': 1e-200}, {'aperture': 1001.0}, {'focal_length_mm': -1.0},
                      {'circle_of_confusion_mm': float('nan')}, {'circle_of_confusion_mm': 1e-200},
                      {'min_region_size': -1}, {'dof_rule': 'none'}):
            shown = self.client.update_configuration(wrong)
            for name, good in dict(DEFAULTS, aperture=5.6).items():
                self.assertEqual(shown[name], good)
                self.assertEqual(rospy.get_param('/alone/segmenter/' + name), good)
        self.assertAlmostEqual(self.cut()[1].optics.aperture, 5.6)

    def test_colour_picture(self):
        picture = self.listen('/alone/segmentation/image_color', Image)
        stamp = next(STAMPS)
        self.cut(stamp=stamp)
        message = picture.at(stamp)
        self.assertEqual(message.encoding, 'rgb8')
        near, far = pixels_of(message)[0, 0], pixels_of(message)[0, -1]
        self.assertEqual([near.argmax(), far.argmax()], [0, 2])  # red, blue

    def test_focus_plan(self):
        plans = self.listen('/alone/segmentation/focus_plan', FocusPlan)
        stamp = next(STAMPS)
        _, array = self.cut(stamp=stamp)
        plan = plans.at(stamp)
        self.assertEqual([plan.header.frame_id, plan.optics, plan.segments], ['color', array.optics, 2])
        np.testing.assert_allclose(plan.focus_distance, [1.0, 3.0], rtol=1e-6)
        hyperfocal_m = 24.0 ** 2 / (4.0 * 0.019) / 1000
        for focus, near, far in zip(plan.focus_distance, plan.near_limit, plan.far_limit):
            np.testing.assert_allclose([1 / near - 1 / focus, 1 / focus - 1 / far], 1 / hyperfocal_m, rtol=1e-6)
        self.client.update_configuration({'aperture': 22.0})  # now one exposure reaches both
        stamp = next(STAMPS)
        self.cut(stamp=stamp)
        np.testing.assert_allclose(plans.at(stamp).focus_distance, [1.5], rtol=1e-6)

    def test_the_lens_is_published_for_bags(self):
        self.client.update_configuration({'aperture': 2.0})
        late = self.listen('/alone/rgb/optics', Optics)
        self.assertTrue(wait_until(lambda: late.messages == [Optics(24.0, 2.0, 0.019)]), late.messages)
        self.client.update_configuration({'focal_length_mm': 50.0})
        self.assertTrue(wait_until(lambda: late.messages[-1] == Optics(50.0, 2.0, 0.019)), late.messages)

    def test_what_it_cannot_follow_is_dropped_and_counted(self):
        counts = lambda status: {name: int(values_of(status)[name]) for name in ('processed', 'dropped')}
        before = counts(self.diagnostics.next('alone/segmenter'))
        noise, sent = np.random.default_rng(0).integers(2000, 2010, (960, 1280)).astype(np.uint16), []

        def dropped():
            """Of images that come at once."""
            stamps = [next(STAMPS) for _ in range(10)]
            for message in [image_message(noise, stamp) for stamp in stamps]:
                self.depth.say(message)
            sent.extend(stamps)
            self.assertIsNotNone(self.labels.at(stamps[-1]), 'the newest was dropped')
            all_counted = lambda status: sum(counts(status).values()) == sum(before.values()) + len(sent)
            return counts(self.diagnostics.wait('alone/segmenter', all_counted))['dropped'] - before['dropped']
        self.assertTrue(wait_until(dropped))

    def test_time_may_jump_back(self):
        for stamp in (900, 901, 100, 101):
            self.assertEqual(len(self.cut(stamp=stamp)[1].segments), 2)


class ChainTest(GraphTest):
    OUTPUTS = {'depth_registered/image_raw': Image, 'depth_registered/image': Image,
               'depth_registered/camera_info': CameraInfo, 'segmentation/labels': Image,
               'segmentation/segments': SegmentArray}

    def setUp(self):
        super().setUp()
        self.depth = self.talk('/chain/depth/image_raw', Image)
        self.depth_info = self.talk('/chain/depth/camera_info', CameraInfo)
        self.rgb_info = self.talk('/chain/rgb/camera_info', CameraInfo)

    def listen_to_all(self):
        """Lazy nodes take a moment to find each other: what comes before that is lost."""
        listeners = {name: self.listen('/chain/' + name, kind) for name, kind in self.OUTPUTS.items()}

        def awake():
            stamp = next(STAMPS)
            self.send(stamp)
            return listeners['segmentation/labels'].at(stamp, timeout=0.5)
        self.assertTrue(wait_until(awake))
        return listeners

    def send(self, stamp, depth=None):
        self.depth.say(image_message(two_planes() if depth is None else depth, stamp))
        self.depth_info.say(camera_info(stamp, 'depth'))
        self.rgb_info.say(camera_info(stamp, 'color'))

    def test_labels_come_out_of_raw_depth(self):
        processed = [self.listen(f'/chain/{part}/processed', Header) for part in ('depth_registered', 'segmentation')]
        listeners, stamp = self.listen_to_all(), next(STAMPS)
        self.send(stamp)
        results = {name: listener.at(stamp) for name, listener in listeners.items()}
        for name, message in results.items():
            self.assertIsNotNone(message, name)
            self.assertEqual(message.header.frame_id, 'color', name)
        for name in ('depth_registered/image_raw', 'depth_registered/image'):
            self.assertEqual(results[name].encoding, '16UC1')
            self.assertGreater((pixels_of(results[name]) == two_planes()).mean(), 0.95, name)
        self.assertEqual(results['depth_registered/camera_info'].K[0], 50.0)
        labels = pixels_of(results['segmentation/labels'])
        self.assertGreater((labels == np.where(two_planes() == NEAR_MM, 1, 2)).mean(), 0.95)
        self.assertEqual(len(results['segmentation/segments'].segments), 2)
        for listener in processed:
            self.assertIsNotNone(listener.at(stamp))

    def test_a_depth_before_its_camera_infos_is_not_lost(self):
        raw = self.listen('/chain/depth_registered/image_raw', Image)
        stamp = next(STAMPS)
        self.depth.say(image_message(two_planes(), stamp))
        self.assertIsNone(raw.at(stamp, timeout=0.5))
        self.depth_info.say(camera_info(stamp, 'depth'))
        self.rgb_info.say(camera_info(stamp, 'color'))
        self.assertIsNotNone(raw.at(stamp))

    def test_subscribes_only_while_somebody_listens(self):
        topics = ['/chain/' + name for name in ('depth/image_raw', 'depth/camera_info', 'rgb/camera_info')]
        idle = lambda: not any(subscribers_of(topic) for topic in topics)
        for output, kind in (('depth_registered/camera_info', CameraInfo), ('segmentation/image_color', Image),
                             ('segmentation/focus_plan', FocusPlan)):
            self.assertTrue(wait_until(idle))
            self.listen('/chain/' + output, kind)
            self.assertTrue(wait_until(lambda: all(subscribers_of(topic) for topic in topics)), output)
            self.listeners.pop().close()
            self.assertTrue(wait_until(idle), output)

    def test_mode_and_filling_can_be_changed(self):
        client = Client('/chain/depth_preprocess', timeout=TIMEOUT)
        self.addCleanup(client.update_configuration, {'mode': 'refined', 'fill_holes': True})
        self.assertEqual(client.update_configuration({'mode': 'best'})['mode'], 'refined')
        listeners = self.listen_to_all()
        depth = two_planes()
        depth[20:24, 40:44] = 0
        hole = (slice(21, 23), slice(41, 43))
        for config, value in (({'fill_holes': True}, FAR_MM), ({'fill_holes': False}, 0),
                              ({'mode': 'paper', 'fill_holes': True}, FAR_MM)):
            client.update_configuration(config)
            stamp = next(STAMPS)
            self.send(stamp, depth)
            filled = pixels_of(listeners['depth_registered/image'].at(stamp))
            self.assertTrue((filled[hole] == value).all(), (config, filled[hole]))

    def test_time_may_jump_back(self):
        raw = self.listen('/chain/depth_registered/image_raw', Image)
        for stamp in (500, 501, 10, 11):
            self.send(stamp)
            self.assertIsNotNone(raw.at(stamp), stamp)

    def test_diagnostics_name_node_and_hardware(self):
        listeners, stamp = self.listen_to_all(), next(STAMPS)
        self.send(stamp)
        listeners['segmentation/labels'].at(stamp)
        for node in ('chain/depth_preprocess', 'chain/segmenter'):
            status = self.diagnostics.wait(node, lambda s: s.level == 0 and s.message == 'processing')
            self.assertTrue(status.hardware_id)
            values = values_of(status)
            self.assertGreater(float(values['rate [Hz]']), 0)
            for key in ('processed', 'dropped', 'unmatched', 'invalid', 'delay [ms]', 'last error'):
                self.assertIn(key, values)


if __name__ == '__main__':
    run_tests(__file__)
