#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Kinect node on cameras without hardware, through OpenNI2: what it publishes, and says when things go wrong."""
import math
import tempfile
import time
import unittest

import numpy as np
from rosgraph_msgs.msg import Log

from depth_testing import pixels_of, run_tests, values_of, wait_until
from kinect_testing import (HEIGHT, SAMPLE, WIDTH, X, Y, KinectTest, depth_pattern, index_of,
                            is_running, plug, recorded_depth, unplug)

FIRST, SECOND = 'first/kinect_openni2', 'second/kinect_openni2'
FOCAL_PX = WIDTH / 2 / math.tan(1.0145 / 2)  # of the field of view that the cameras tell


class ImagesTest(KinectTest):
    def check_depth(self, message, invalid=2047):
        self.assertEqual((message.width, message.height, message.step), (WIDTH, HEIGHT, 2 * WIDTH))
        self.assertEqual((message.encoding, message.is_bigendian, len(message.data)), ('16UC1', 0, 2 * WIDTH * HEIGHT))
        depth = pixels_of(message)
        truth = depth_pattern(index_of(depth))
        np.testing.assert_array_equal(depth, np.where(truth == invalid, 0, truth))

    def test_depth_in_mm_unmirrored_and_unregistered_at_thirty_hertz(self):
        plug('one')
        depth, infos = self.images('/first/depth/image_raw'), self.infos('/first/depth/camera_info')
        began = time.monotonic()
        messages = depth.wait(40)
        self.assertGreater(time.monotonic() - began, 1.0)
        for message in messages[::8]:
            self.check_depth(message)
        self.assertEqual(messages[0].header.frame_id, 'kinect_depth_optical_frame')
        self.assertTrue(wait_until(lambda: messages[-1].header.stamp in [i.header.stamp for i in infos.messages]))
        info = infos.messages[-1]
        self.assertEqual((info.width, info.height, info.header.frame_id),
                         (WIDTH, HEIGHT, 'kinect_depth_optical_frame'))
        np.testing.assert_allclose(info.K, [FOCAL_PX, 0, 319.5, 0, FOCAL_PX, 239.5, 0, 0, 1], rtol=1e-5)
        np.testing.assert_allclose(info.P, [FOCAL_PX, 0, 319.5, 0, 0, FOCAL_PX, 239.5, 0, 0, 0, 1, 0], rtol=1e-5)
        status = self.status(FIRST, 'processing')
        self.assertEqual(values_of(status)['device'], '"frames:one" (Test camera, all_in_focus)')
        self.assertIn('640x480 at 30 Hz', values_of(status)['depth/image_raw'])
        self.assertGreater(float(values_of(status)['rate [Hz]']), 1)

    def test_stamps_keep_the_pace_of_the_camera_though_images_come_late(self):
        plug('one', 'late')
        depth = self.images('/first/depth/image_raw')
        depth.wait(75)
        stamps, delays = depth.stamps(), depth.delays()
        self.assertTrue((np.diff(stamps) > 0).all())
        self.assertTrue((delays > -0.001).all(), delays)
        self.assertLess(delays.min(), 0.1)
        # That every fourth image comes 15 ms late is not in the stamps.
        indices = np.array([index_of(pixels_of(message)) for message in depth.messages])[40:]
        phases = stamps[40:] - indices / 30
        late = indices % 4 == 0
        self.assertLess(abs(np.median(phases[late]) - np.median(phases[~late])), 0.005)

    def test_stamps_survive_a_camera_clock_that_starts_again(self):
        plug('one', 'clock_back')
        depth = self.images('/first/depth/image_raw')
        depth.wait(60)
        self.assertTrue((np.diff(depth.stamps()) > 0).all())
        self.assertLess(np.abs(depth.delays()).min(), 0.5)

    def test_camera_that_cannot_be_told_not_to_mirror(self):
        plug('one', 'stuck_mirror')
        self.check_depth(self.images('/first/depth/image_raw').wait(2)[-1])

    def test_second_camera_with_calibration_and_invalid_values_of_its_own(self):
        plug('one')
        plug('two')
        depth, infos = self.images('/second/depth/image_raw'), self.infos('/second/depth/camera_info')
        self.check_depth(depth.wait(2)[-1], invalid=1000)
        self.assertTrue(wait_until(lambda: infos.messages))
        self.assertEqual([infos.messages[-1].K[0], infos.messages[-1].D[0]], [583.9, 0.1])
        self.assertEqual(infos.messages[-1].header.frame_id, 'side_depth_optical_frame')
        self.assertIn('frames:two', values_of(self.status(SECOND, 'processing'))['device'])

    def test_infrared_or_colour_beside_depth(self):
        plug('one')
        plug('two')
        log = self.images('/rosout', Log)
        depth, ir = self.images('/second/depth/image_raw'), self.images('/second/ir/image_raw')
        depth.wait(2)
        infos = self.infos('/second/ir/camera_info')
        message, info = ir.wait(2)[-1], infos.wait(1)[-1]
        self.assertEqual((message.encoding, message.step), ('mono16', 2 * WIDTH))
        index = int(pixels_of(message)[0, 0])
        np.testing.assert_array_equal(pixels_of(message), (X + Y + index) % 1024)
        # Its calibration is for another size: the field of view counts, which is said once.
        self.assertAlmostEqual(info.K[0], FOCAL_PX, places=1)
        warnings = lambda: [line for line in log.messages if 'side_ir: the calibration is for 320x240' in line.msg]
        self.assertTrue(wait_until(warnings))
        ir.wait(5)
        self.assertEqual(len(warnings()), 1)

        colour = self.images('/second/kinect_rgb/image_raw')
        status = self.status(SECOND, 'either IR or colour')
        self.assertEqual(status.level, 2)
        self.assertFalse(colour.messages)
        ir.close()
        infos.close()
        message = colour.wait(2)[-1]
        self.assertEqual((message.encoding, message.step), ('rgb8', 3 * WIDTH))
        np.testing.assert_array_equal(pixels_of(message)[..., 0], X % 256)
        np.testing.assert_array_equal(pixels_of(message)[..., 1], Y % 256)
        depth.wait(2)

    @unittest.skipUnless(SAMPLE.is_file(), f'RECORDED DEPTH NOT TESTED: no {SAMPLE}; set ALL_IN_FOCUS_DATA')
    def test_depth_of_a_real_kinect_pixel_for_pixel(self):
        truth = recorded_depth()
        self.assertGreater(np.count_nonzero(truth), truth.size // 2)
        with tempfile.NamedTemporaryFile() as file:
            truth.tofile(file.name)
            plug('one', 'recorded=' + file.name)
            depth = self.images('/first/depth/image_raw').wait(2)
        np.testing.assert_array_equal(pixels_of(depth[-1]), np.where(truth == 2047, 0, truth))

    def test_streams_run_only_while_somebody_listens(self):
        plug('one')
        self.diagnostics.wait(FIRST, lambda s: 'frames:one' in values_of(s)['device'] and 'idle' in s.message)
        self.assertFalse([topic for topic in ('depth', 'ir', 'kinect_rgb') if is_running('one', topic)])
        for listen in (lambda: self.images('/first/depth/image_raw'), lambda: self.infos('/first/depth/camera_info')):
            listener = listen()
            listener.wait(2)
            self.assertTrue(is_running('one', 'depth'))
            self.assertFalse(is_running('one', 'ir') or is_running('one', 'kinect_rgb'))
            listener.close()
            self.assertTrue(wait_until(lambda: not is_running('one', 'depth')))


class FailuresTest(KinectTest):
    def test_error_ends_when_the_camera_is_there_though_nobody_listens(self):
        self.status(FIRST, 'no camera was found')
        plug('one')
        self.assertEqual(self.status(FIRST, 'idle: nobody listens').level, 0)

    def test_no_camera_then_one_then_two(self):
        depth = self.images('/first/depth/image_raw')
        status = self.status(FIRST, 'no camera was found: is it plugged in')
        self.assertEqual((status.level, values_of(status)['device']), (2, 'none'))
        plug('one')
        depth.wait(2)
        self.status(SECOND, 'there is no camera #2; found #1 "frames:one" (Test camera, all_in_focus)')
        plug('two')
        self.images('/second/depth/image_raw').wait(2)

    def test_unplugged_and_plugged_in_again_twice(self):
        plug('one')
        depth = self.images('/first/depth/image_raw')
        for _ in range(2):
            depth.wait(5)
            unplug('one')
            self.status(FIRST, 'no camera was found')
            count = len(depth.messages)
            time.sleep(0.2)
            self.assertEqual(len(depth.messages), count)
            plug('one')
        depth.wait(5)
        self.assertTrue((np.diff(depth.stamps()) > 0).all())
        self.assertIn('no camera was found', values_of(self.status(FIRST, 'processing'))['last error'])

    def test_broken_images_are_refused_and_the_others_go_on(self):
        reasons = {'short': '614400 bytes are needed, 307200 came',
                   'small': 'it has 320x480 pixels, the stream was set to 640x480',
                   'narrow': 'rows of 1280 bytes cannot be 100 bytes apart'}
        for fault, reason in reasons.items():
            plug('one', fault)
            depth = self.images('/first/depth/image_raw')
            messages = depth.wait(12)
            self.assertFalse([i for i in map(index_of, map(pixels_of, messages)) if i % 3 == 0], fault)
            status = self.diagnostics.wait(FIRST, lambda s: reason in s.message)
            self.assertGreater(int(values_of(status)['invalid']), 1)
            depth.close()
            self.assertTrue(wait_until(lambda: not is_running('one', 'depth')))
            unplug('one')
            self.status(FIRST, 'no camera was found')

    def test_images_that_never_came_are_counted(self):
        depth = self.images('/first/depth/image_raw')
        self.assertTrue(wait_until(lambda: depth.subscriber.get_num_connections()))  # so that it sees the first
        before = int(values_of(self.status(FIRST, 'no camera was found'))['dropped'])
        plug('one', 'drop')
        depth.wait(30)
        depth.close()
        self.assertTrue(wait_until(lambda: not is_running('one', 'depth')))
        indices = [index_of(pixels_of(message)) for message in depth.messages]
        self.assertFalse(set(indices) & set(range(10, 15)))
        lost = int(np.sum(np.diff(indices) - 1))  # more than five on a computer that is too slow
        self.assertGreaterEqual(lost, 5)
        status = self.status(FIRST, 'idle: nobody listens')
        self.assertEqual((int(values_of(status)['dropped']) - before, status.level), (lost, 0))

    def test_camera_that_falls_silent_is_opened_again(self):
        plug('one', 'silent forgotten')
        depth = self.images('/first/depth/image_raw')
        self.status(FIRST, 'no depth image from "frames:one" (Test camera, all_in_focus) for 1 s: opening it again')
        plug('one', 'forgotten')
        depth.wait(2)

    def test_camera_that_does_not_open_or_start(self):
        plug('one', 'no_open')
        depth = self.images('/first/depth/image_raw')
        self.status(FIRST, 'cannot open the first camera (the camera is in use); found #1 "frames:one"')
        for fault, what in (('stuck_registration', 'switch off the hardware registration of the depth stream'),
                            ('no_mode', 'set the depth stream of "frames:one" (Test camera, all_in_focus) to 640x480'),
                            ('no_start', 'start the depth stream of "frames:one"')):
            plug('one', fault)
            self.status(FIRST, 'cannot ' + what)
            self.assertFalse(depth.messages)
        plug('one')
        depth.wait(2)


if __name__ == '__main__':
    run_tests(__file__)
