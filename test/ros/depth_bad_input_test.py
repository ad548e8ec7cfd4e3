#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bad input to the depth nodes: nobody dies, the diagnostics say what is wrong, the next good depth is processed."""
import itertools
import time

import numpy as np
import rospy
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from depth_testing import (ERROR, HEIGHT, OK, WARN, WIDTH, AloneTest, GraphTest, Talker, camera_info, image_message, pixels_of,
                           run_tests, transform, two_planes, values_of)

STAMPS = itertools.count(1000)
LAST_STAMP = rospy.Time(4294967295, 950000000)


def changed(message, **fields):
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def bad_images():
    """What is wrong with it, the message."""
    good = lambda: image_message(two_planes(), next(STAMPS))
    yield 'encoding', changed(good(), encoding='rgb8')
    yield 'encoding', changed(good(), encoding='')
    yield 'empty', changed(good(), width=0, height=0, step=0, data=b'')
    yield 'empty', changed(good(), height=0)
    yield 'step', changed(good(), step=WIDTH)
    yield 'step', changed(good(), step=2 * WIDTH + 1)
    yield 'data', changed(good(), data=b'\1' * 100)
    yield 'data', changed(good(), height=2 ** 32 - 1)
    yield 'endian', changed(good(), is_bigendian=1)


class SegmenterTest(AloneTest):
    def setUp(self):
        super().setUp()
        self.processed = self.listen('/alone/segmentation/processed', Header)

    def assert_good_depth_is_processed(self):
        stamp = next(STAMPS)
        self.depth.say(image_message(two_planes(), stamp))
        self.assertIsNotNone(self.labels.at(stamp))
        self.assertEqual(len(self.segments.at(stamp).segments), 2)
        self.diagnostics.wait('alone/segmenter', lambda s: s.level == OK)

    def test_broken_images(self):
        for wrong, message in bad_images():
            self.depth.say(message)
            self.assertIsNotNone(self.processed.at(message.header.stamp.to_sec()), wrong)
            status = self.diagnostics.wait('alone/segmenter', lambda s: s.level == ERROR and wrong in s.message)
            self.assertIn('/alone/depth_registered/image', status.message)
            self.assertIsNone(self.labels.at(message.header.stamp.to_sec(), timeout=0))
        self.assert_good_depth_is_processed()

    def test_an_impossible_stamp_ends_no_node(self):
        info = self.talk('/alone/depth_registered/camera_info', CameraInfo)
        self.listen('/alone/segmentation/markers', MarkerArray)
        for talker, message, topic in ((self.depth, image_message(two_planes(), 0), 'image'),
                                       (info, camera_info(0, 'color'), 'camera_info')):
            message.header.stamp = LAST_STAMP
            talker.say(message)
            self.diagnostics.wait('alone/segmenter', lambda s: s.level == ERROR and 'is impossible' in s.message
                                  and '/alone/depth_registered/' + topic in s.message)
        self.assert_good_depth_is_processed()

    def test_a_camera_of_markers_that_is_broken_is_refused_and_counted(self):
        info = self.talk('/alone/depth_registered/camera_info', CameraInfo)
        self.listen('/alone/segmentation/markers', MarkerArray)
        refused = lambda status: int(values_of(status)['invalid'])
        before = refused(self.diagnostics.next('alone/segmenter'))
        info.say(camera_info(0, 'color', 0.0))
        self.diagnostics.wait('alone/segmenter', lambda s: s.level == ERROR and 'not calibrated' in s.message
                              and '/alone/depth_registered/camera_info' in s.message and refused(s) == before + 1)
        self.assert_good_depth_is_processed()

    def test_no_depth_at_all(self):
        for pixels, encoding in ((np.zeros((HEIGHT, WIDTH), np.uint16), '16UC1'),
                                 (np.full((HEIGHT, WIDTH), np.nan, np.float32), '32FC1')):
            stamp = next(STAMPS)
            self.depth.say(image_message(pixels, stamp, encoding))
            self.assertFalse(pixels_of(self.labels.at(stamp)).any())
            segments = self.segments.at(stamp)
            self.assertEqual([len(segments.segments), segments.unknown_area], [0, WIDTH * HEIGHT])
            self.diagnostics.wait('alone/segmenter', lambda s: s.level == WARN and 'not one pixel' in s.message)
        self.assert_good_depth_is_processed()

    def test_smallest_image(self):
        stamp = next(STAMPS)
        self.depth.say(image_message(np.full((1, 1), 1500, np.uint16), stamp))
        self.assertEqual(pixels_of(self.labels.at(stamp)).tolist(), [[1]])

    def test_silence_is_reported_with_the_topic(self):
        self.assert_good_depth_is_processed()
        self.diagnostics.wait('alone/segmenter',
                              lambda s: s.level == WARN and '/alone/depth_registered/image' in s.message)


class DepthPreprocessTest(GraphTest):
    NODE = 'chain/depth_preprocess'

    def setUp(self):
        super().setUp()
        self.depth = self.talk('/chain/depth/image_raw', Image)
        self.infos = {name: self.talk(f'/chain/{name}/camera_info', CameraInfo) for name in ('depth', 'rgb')}
        self.raw = self.listen('/chain/depth_registered/image_raw', Image)
        self.processed = self.listen('/chain/depth_registered/processed', Header)

    def send(self, *arguments, **options):
        """Returns the stamp."""
        stamp = next(STAMPS)
        self.send_depth(stamp, *arguments, **options)
        return stamp

    def talk_of_transforms(self, topic):
        """Nodes listen to transforms all the time: close() would wait in vain for the end of that."""
        talker = Talker(topic, TFMessage)
        self.addCleanup(talker.publisher.unregister)
        return talker

    def assert_error(self, *words):
        self.diagnostics.wait(self.NODE, lambda s: s.level == ERROR and all(word in s.message for word in words))

    def assert_good_depth_is_processed(self):
        self.assertIsNotNone(self.raw.at(self.send()))
        self.diagnostics.wait(self.NODE, lambda s: s.level == OK)

    def test_a_transport_that_changes_depths_or_is_not_installed_is_raw(self):
        using_raw = '~image_transport: using raw: '
        for transport, complaint, shown in (
                ('compressed', using_raw + "'compressed' may change depths, only raw and compressedDepth do not", 'raw'),
                ('compressedDepth', using_raw + "Unable to load plugin for transport 'compressedDepth'", 'raw'),
                (5, "image_transport must be text, not 5: using 'raw'", 5)):
            self.diagnostics.wait(self.NODE, lambda s: 'nobody listens' not in s.message)  # it has seen those that go now
            rospy.set_param('/' + self.NODE + '/image_transport', transport)
            for listener in (self.raw, self.processed):
                listener.close()
            self.diagnostics.wait(self.NODE, lambda s: 'nobody listens' in s.message)  # the next listener counts as the first
            self.raw = self.listen('/chain/depth_registered/image_raw', Image)
            self.assert_error(complaint)
            self.assertEqual(rospy.get_param('/' + self.NODE + '/image_transport'), shown)
        self.assert_good_depth_is_processed()

    def test_an_impossible_stamp_ends_no_node(self):
        for talker, message, topic in ((self.depth, image_message(two_planes(), 0), '/chain/depth/image_raw'),
                                       (self.infos['depth'], camera_info(0, 'depth'), '/chain/depth/camera_info'),
                                       (self.infos['rgb'], camera_info(0, 'color'), '/chain/rgb/camera_info')):
            message.header.stamp = LAST_STAMP
            talker.say(message)
            self.assert_error(topic, 'stamp 4294967295 s 950000000 ns is impossible')
        self.assert_good_depth_is_processed()

    def test_an_impossible_stamp_of_a_transform_ends_no_node(self):
        pose, talker = transform('somewhere'), self.talk_of_transforms('/tf')
        for pose.header.stamp in (LAST_STAMP, rospy.Time(1)):
            talker.say(TFMessage([pose]))
        self.assert_error('/tf', 'is impossible')
        self.assert_good_depth_is_processed()

    def test_sizes_that_no_sensor_has_are_refused(self):
        huge = camera_info(0, 'color')
        huge.width = huge.height = 20000
        outside = camera_info(0, 'color')
        outside.roi.width = outside.roi.height = 46000
        for info, words in ((huge, '100 megapixels'), (outside, 'region of interest')):
            self.send(rgb=info)
            self.assert_error('/chain/rgb/camera_info', words)
        self.assert_good_depth_is_processed()

    def test_uncalibrated_cameras_are_named(self):
        for name, info in (('depth', camera_info(0, 'depth', 0.0)), ('rgb', camera_info(0, 'color', 0.0)),
                           ('rgb', camera_info(0, 'color', float('nan')))):
            stamp = self.send(**{name: info})
            self.assert_error(f'/chain/{name}/camera_info', 'not calibrated')
            self.assertIsNotNone(self.processed.at(stamp))
        self.assert_good_depth_is_processed()

    def test_what_goes_on_is_logged_once(self):
        log = []
        listener = rospy.Subscriber('/rosout', Log, log.append)
        self.addCleanup(listener.unregister)
        told = lambda: [line for line in log if '/chain/rgb/camera_info' in line.msg and 'no pinhole' in line.msg]
        for _ in range(3):
            stamp = self.send(rgb=camera_info(0, 'color', model='no pinhole'))
            self.assertIsNotNone(self.processed.at(stamp))
            time.sleep(1.1)
        self.assertEqual(len(told()), 1)
        self.assert_good_depth_is_processed()

    def test_unknown_distortion_model_is_named(self):
        self.send(rgb=camera_info(0, 'color', model='omni'))
        self.assert_error('/chain/rgb/camera_info', 'omni')
        self.assert_good_depth_is_processed()

    def test_missing_transform_names_both_frames(self):
        self.send(frame='nowhere')
        self.assert_error('nowhere', 'color', 'static_transform_publisher')
        self.assert_good_depth_is_processed()

    def test_missing_frame_ids(self):
        self.send(frame='')
        self.assert_error('frame_id', '/chain/depth/image_raw')
        self.send(rgb=camera_info(0, ''))
        self.assert_error('frame_id', '/chain/rgb/camera_info')
        self.assert_good_depth_is_processed()

    def test_broken_images(self):
        self.assert_good_depth_is_processed()  # camera infos are known
        for wrong, message in bad_images():
            self.depth.say(message)
            self.assertIsNotNone(self.processed.at(message.header.stamp.to_sec()), wrong)
            self.assert_error(wrong, '/chain/depth/image_raw')
        self.assert_good_depth_is_processed()

    def test_size_that_is_not_calibrated(self):
        self.send(np.ones((10, 20), np.uint16))
        self.assert_error('20x10', f'{WIDTH}x{HEIGHT}')
        self.assert_good_depth_is_processed()

    def test_values_that_mean_nothing(self):
        for value, kind in ((2047, np.uint16), (np.nan, np.float32), (-1, np.float32), (2.047, np.float32)):
            encoding = '16UC1' if kind == np.uint16 else '32FC1'
            depth = (two_planes() / (1 if kind == np.uint16 else 1000)).astype(kind)
            depth[10:30] = value
            registered = pixels_of(self.raw.at(self.send(depth, encoding=encoding)))
            self.assertFalse(registered[12:28].any(), value)
            self.assertEqual(registered[40, 10], 1000)

    def test_no_depth_at_all(self):
        stamp = self.send(np.full((HEIGHT, WIDTH), 2047, np.uint16))
        self.assertFalse(pixels_of(self.raw.at(stamp)).any())
        self.diagnostics.wait(self.NODE, lambda s: s.level == WARN and 'not one pixel' in s.message)
        self.assert_good_depth_is_processed()

    def test_a_rig_that_is_most_likely_a_mistake(self):
        """In the words of fuse_stack and check_bag."""
        column = two_planes()
        column[:, 2:] = 0
        cases = [(WARN, 'depth_mm', (0, 0, -2.5), two_planes(),
                  'the depth camera stands 2.5 m from the colour camera, rotated by 0 degrees: are these mm?'),
                 (WARN, 'depth', None, column,
                  'only 3.1 % of the colour picture gets a depth: check the transform and both calibrations'),
                 (WARN, 'depth', None, two_planes() // 1000, 'half of the depths are 1 or less: m, but a depth image means mm'),
                 (ERROR, 'depth_aside', (50, 0, 0), two_planes(),
                  'no depth falls into the colour picture: check the transform and both calibrations')]
        talker = self.talk_of_transforms('/tf_static')
        for level, frame, place, depth, words in cases:
            if place is not None:
                talker.say(TFMessage([transform(frame, place)]))  # depth waits for it
            self.assertIsNotNone(self.raw.at(self.send(depth, frame=frame)), words)
            self.diagnostics.wait(self.NODE, lambda s: s.level == level and '/chain/depth/image_raw: ' + words in s.message)
            self.assert_good_depth_is_processed()


if __name__ == '__main__':
    run_tests(__file__)
