#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of a wrong type or out of range: one line names each, and the value that is used."""
import math
import unittest

import numpy as np
import rospy
from roslib.packages import find_node
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from depth_testing import GraphTest, image_message, run_tests, values_of, wait_until
from process_testing import Talkative

INVALID = 'invalid_values must be a list of whole numbers from 0 to 65535, not %s: using [0, 2047, 65535]'

# node, parameter -> (what the user gives, what the node says, what it then uses)
CASES = [
    ('depth_preprocess', {
        'queue_size': (-5, 'queue_size must be a whole number from 1 to 1000, not -5: using 5', None),
        'invalid_values': ('none', INVALID % "'none'", None),
        'mode': ('best', 'mode = best, must be paper or refined: using refined', 'refined'),
        'fill_holes': ('false', "fill_holes must be true or false, not 'false': using true", True)}),
    ('depth_preprocess', {'invalid_values': ([0, 2047.5, True], INVALID % '[0, 2047.5, true]', None)}),
    ('depth_preprocess', {'invalid_values': ([0, True], INVALID % '[0, true]', None)}),
    ('depth_preprocess', {'invalid_values': ([-1, 'far', [0]], INVALID % "[-1, 'far', [0]]", None)}),
    ('depth_preprocess', {'invalid_values': ([0, 65536], INVALID % '[0, 65536]', None)}),
    ('depth_preprocess', {'invalid_values': ([0, 65535.0], None, None)}),
    ('segmenter', {
        'queue_size': (2.5, 'queue_size must be a whole number from 1 to 1000, not 2.5: using 5', None),
        'mode': (3, "mode must be text, not 3: using 'refined'", None),
        'focal_length_mm': ('35', "focal_length_mm must be a number, not '35': using 24", 24.0),
        'aperture': ('wide', "aperture must be a number, not 'wide': using 4", 4.0),
        'circle_of_confusion_mm': (0, 'circle_of_confusion_mm = 0, must be from 1e-06 to 10: using 0.019', 0.019),
        'min_region_size': (7.0, None, 7)}),
    ('segmenter', {
        'focal_length_mm': (35000, 'focal_length_mm = 20000, must be from 0.1 to 10000: using 24', 24.0),
        'min_region_size': (200000, 'min_region_size = 100001, must be from 0 to 100000: using 100000', 100000),
        'caption_min_area': (150, 'caption_min_area = 101, must be from 0 to 100: using 100', 100.0)}),
    ('fusion', {
        'queue_size': ('many', "queue_size must be a whole number from 1 to 1000, not 'many': using 60", None),
        'diagnostic_period': (0, 'diagnostic_period must be a number from 0.01 to 3600, not 0: using 1', None),
        'restore_every_bracket': (1, 'restore_every_bracket must be true or false, not 1: using false', None),
        'mode': (3, "mode must be text, not 3: using 'refined'", 'refined'),
        'bracket_size': ('five', "bracket_size must be a whole number, not 'five': using 0", 0),
        'bracket_gap': (True, 'bracket_gap must be a number, not true: using 1', 1.0),
        'label_timeout': ([1, 2], 'label_timeout must be a number, not [1, 2]: using 2', 2.0),
        'label_max_age': (3, None, 3.0)}),
    ('fusion', {
        'reference': (-7, 'reference = -2, must be from -1 to 65534: using -1', -1),
        'max_held_frames': (100000, 'max_held_frames = 65535, must be from 0 to 65534: using 65534', 65534),
        'bracket_size': (2.5, 'bracket_size must be a whole number, not 2.5: using 0', 0),
        'bracket_gap': (math.inf, 'bracket_gap = 3601, must be from 0 to 3600: using 3600', 3600.0),
        'label_max_age': (math.nan, 'label_max_age = nan, must be from 0 to 3600: using 1', 1.0),
        'label_timeout': (100, 'label_timeout = 61, must be from 0 to 60: using 60', 60.0)})]


def start(test, node, parameters, *remappings):
    rospy.set_param('/' + node, parameters)
    process = Talkative([find_node('all_in_focus', node)[0], *remappings], ROSCONSOLE_STDOUT_LINE_BUFFERED='1')
    test.addCleanup(process.stop)
    test.assertTrue(process.said('publishes  /'))
    return process


class ParametersTest(unittest.TestCase):
    def test_each_is_named_once_and_what_is_used_is_shown(self):
        for node, cases in CASES:
            process = start(self, node, {name: given for name, (given, _, _) in cases.items()})
            for name, (_, line, used) in cases.items():
                if line:
                    self.assertTrue(process.said(f'/{node}: '))
                    self.assertTrue(process.said(line), (line, process.lines))
                self.assertEqual(sum(name in said for said in process.lines), 1 if line else 0, process.lines)
                if used is not None:
                    self.assertEqual(rospy.get_param(f'/{node}/{name}'), used)

    def test_good_ones_are_used_without_a_word(self):
        for node in {node for node, _ in CASES}:
            process = start(self, node, {'queue_size': 7})
            self.assertFalse([line for line in process.lines if 'WARN' in line or 'ERROR' in line])


class SilenceTest(GraphTest):
    def test_each_silent_input_has_its_line(self):
        topics = ['/camera_1/camera_info', '/camera_2/camera_info']
        for topic in topics:
            self.talk(topic, CameraInfo)
        process = start(self, 'depth_preprocess', {}, 'depth/camera_info:=' + topics[0], 'rgb/camera_info:=' + topics[1])
        self.listen('depth_registered/image', Image)
        for topic in topics:
            self.assertTrue(process.said(f'no data for 5 s on {topic}: connected, but no message comes'), process.lines)


class QueueSizeTest(GraphTest):
    def test_what_waits_is_bounded_and_every_image_is_acknowledged(self):
        process = start(self, 'segmenter', {'queue_size': 1})
        depth, processed = self.talk('depth_registered/image', Image), self.listen('segmentation/processed', Header)
        labels = self.listen('segmentation/labels', Image)
        noise = np.random.default_rng(1).integers(500, 5000, (750, 1000), np.uint16)  # takes much longer than its way
        stamps = [1000 + number for number in range(30)]
        for stamp in stamps:
            depth.say(image_message(noise, stamp))
        self.assertTrue(wait_until(lambda: len(processed.messages) == len(stamps)), len(processed.messages))
        self.assertIsNotNone(labels.at(stamps[-1]))
        self.assertTrue(process.said('cannot keep up: oldest waiting image dropped'))
        counts = values_of(self.diagnostics.wait('segmenter', lambda status: True))
        self.assertEqual(int(counts['processed']) + int(counts['dropped']), len(stamps))
        self.assertGreater(int(counts['dropped']), 0)


if __name__ == '__main__':
    run_tests(__file__)
