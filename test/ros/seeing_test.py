#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What people look at: captions in picture and space, the topics of the rviz file, the parameters' descriptions."""
import ast
import functools
import itertools
from pathlib import Path

import cv2
import numpy as np
import rospy
import yaml
from dynamic_reconfigure.client import Client
from dynamic_reconfigure.msg import Config, ConfigDescription
from sensor_msgs.msg import CameraInfo, Image
from visualization_msgs.msg import Marker, MarkerArray

from all_in_focus.msg import SegmentArray
import depth_testing
from depth_testing import FAR_MM, NEAR_MM, TIMEOUT, GraphTest, image_message, pixels_of, run_tests, wait_until

STAMPS = itertools.count(1000)
RVIZ_FILE = Path(__file__).resolve().parents[2] / 'rviz/all_in_focus.rviz'
TYPES = {'rviz/Image': 'sensor_msgs/Image', 'rviz/DepthCloud': 'sensor_msgs/Image',
         'rviz/MarkerArray': 'visualization_msgs/MarkerArray'}
INFO = 'depth_registered/camera_info'
WIDTH, HEIGHT = 320, 240  # large enough for captions side by side
two_planes = functools.partial(depth_testing.two_planes, WIDTH, HEIGHT)


def camera_info(stamp, focal_px=250.0):
    info = depth_testing.camera_info(stamp, 'color')
    info.width, info.height = WIDTH, HEIGHT
    info.K = [focal_px, 0, WIDTH / 2, 0, focal_px, HEIGHT / 2, 0, 0, 1]
    return info


def u_around_a_block():
    """Far away a U whose centroid lies in the near block that it goes around; nothing is known of the rest [mm]."""
    depth = np.zeros((HEIGHT, WIDTH), np.uint16)
    depth[30:220, 40:280] = FAR_MM
    depth[30:220, 40:60] += 100
    depth[40:160, 110:210] = NEAR_MM
    return depth


def pixel_of(marker, info):
    """Where a camera sees a marker."""
    at = marker.pose.position
    return cv2.projectPoints(np.array([[at.x, at.y, at.z]]), np.zeros(3), np.zeros(3), np.array(info.K).reshape(3, 3),
                             np.array(info.D))[0].ravel()


class CaptionTest(GraphTest):
    """A segmenter on its own."""

    def setUp(self):
        super().setUp()
        self.client = Client('/alone/segmenter', timeout=TIMEOUT)
        self.client.update_configuration({'caption_min_area': 0.5})
        self.depth = self.talk('/alone/depth_registered/image', Image)

    def listen_to_markers(self):
        self.markers = self.listen('/alone/segmentation/markers', MarkerArray)
        self.labels = self.listen('/alone/segmentation/labels', Image)
        self.segments = self.listen('/alone/segmentation/segments', SegmentArray)
        self.info = self.talk('/alone/' + INFO, CameraInfo)

    def markers_at(self, stamp, timeout=TIMEOUT):
        found = lambda: [a.markers for a in self.markers.messages if a.markers[0].header.stamp == rospy.Time(stamp)]
        arrays = wait_until(found, timeout)
        self.assertLessEqual(len(arrays), 1)
        return arrays[0] if arrays else None

    def see(self, depth, info=None):
        """Labels, segments and text markers of a depth image; what was there before is to be deleted first."""
        stamp = next(STAMPS)
        self.deliver('alone/segmenter', (self.info, info or camera_info(stamp)))
        self.depth.say(image_message(depth, stamp, frame='color'))
        markers = self.markers_at(stamp)
        self.assertIsNotNone(markers)
        self.assertEqual([m.action for m in markers], [Marker.DELETEALL] + [Marker.ADD] * (len(markers) - 1))
        self.assertEqual({m.header.frame_id for m in markers}, {'color'})
        return pixels_of(self.labels.at(stamp)), self.segments.at(stamp).segments, markers[1:]

    def test_markers_lie_in_their_regions_and_tell_their_depth(self):
        self.listen_to_markers()
        straight, bent = camera_info(0), camera_info(0)
        bent.D = [-0.3, 0.1, 0.01, -0.01, 0.0]
        for info in (straight, bent):
            labels, segments, markers = self.see(u_around_a_block(), info)
            self.assertEqual({m.id for m in markers}, {1, 2})
            for marker in markers:
                at, pixel = marker.pose.position, pixel_of(marker, info)
                x, y = np.rint(pixel).astype(int)
                np.testing.assert_allclose(pixel, (x, y), atol=1e-3)
                self.assertTrue((labels[y - 2:y + 3, x - 2:x + 3] == marker.id).all(), (marker.id, x, y))
                segment = segments[marker.id - 1]
                self.assertAlmostEqual(at.z, segment.depth_min, places=5)
                self.assertEqual(marker.text, f'{marker.id}: {segment.depth_min:.2f}-{segment.depth_max:.2f} m')
                self.assertEqual([marker.type, marker.pose.orientation.w], [Marker.TEXT_VIEW_FACING, 1])
                self.assertGreater(marker.color.a, 0.5)
            near, far = sorted(markers, key=lambda m: m.id)
            self.assertAlmostEqual(far.scale.z / near.scale.z, FAR_MM / NEAR_MM, places=5)
            self.assertGreater(near.scale.z, 0)
            self.assertGreater(near.color.r, near.color.b)
            self.assertGreater(far.color.b, far.color.r)

    def test_markers_of_vanished_segments_are_deleted(self):
        self.listen_to_markers()
        for depth, ids in ((two_planes(), {1, 2}), (np.full_like(two_planes(), FAR_MM), {1}),
                           (np.zeros_like(two_planes()), set())):
            self.assertEqual({m.id for m in self.see(depth)[2]}, ids)

    def test_small_segments_have_no_caption(self):
        self.listen_to_markers()
        depth = two_planes()
        depth[50:70, 200:220] = 500  # 0.52 % of the picture
        self.assertEqual({m.id for m in self.see(depth)[2]}, {1, 2, 3})
        self.client.update_configuration({'caption_min_area': 1.0})
        self.assertEqual({m.id for m in self.see(depth)[2]}, {2, 3})
        self.assertEqual(self.client.update_configuration({'caption_min_area': -0.5})['caption_min_area'], 1.0)

    def test_markers_wait_for_a_calibration_that_fits(self):
        self.listen_to_markers()
        stamp, other = next(STAMPS), camera_info(0)
        other.width = WIDTH // 2
        for info in (other, camera_info(0, 0.0)):
            self.deliver('alone/segmenter', (self.info, info))
        self.depth.say(image_message(two_planes(), stamp, frame='color'))
        self.assertIsNotNone(self.labels.at(stamp))
        self.assertTrue(wait_until(lambda: any('/alone/' + INFO in s.message and 'not calibrated' in s.message
                                               for s in self.diagnostics.statuses)))
        self.assertIsNone(self.markers_at(stamp, timeout=0.2))
        self.info.say(other)
        self.diagnostics.wait('alone/segmenter', lambda s: INFO + ' is for' in s.message)
        self.info.say(camera_info(0))
        self.assertEqual(len(self.markers_at(stamp)), 3)

    def test_an_image_that_came_before_anybody_wanted_markers_has_its_own(self):
        labels, stamp = self.listen('/alone/segmentation/labels', Image), next(STAMPS)
        self.depth.say(image_message(two_planes(), stamp, frame='color'))
        self.assertIsNotNone(labels.at(stamp))
        self.listen_to_markers()
        self.info.say(camera_info(0))
        self.assertEqual(len(self.markers_at(stamp)), 3)

    def test_the_markers_of_the_newest_image_come_with_the_first_listener(self):
        labels, stamp = self.listen('/alone/segmentation/labels', Image), next(STAMPS)
        info = self.talk('/alone/' + INFO, CameraInfo)
        self.deliver('alone/segmenter', (info, camera_info(0)))
        self.depth.say(image_message(two_planes(), stamp, frame='color'))
        self.assertIsNotNone(labels.at(stamp))
        self.markers = self.listen('/alone/segmentation/markers', MarkerArray)
        self.assertEqual(len(self.markers_at(stamp)), 3)

    def test_picture_has_captions(self):
        picture = self.listen('/alone/segmentation/image_color', Image)
        pictures = []
        for least in (0.5, 100.0):
            self.client.update_configuration({'caption_min_area': least})
            stamp = next(STAMPS)
            self.depth.say(image_message(two_planes(), stamp, frame='color'))
            pictures.append(pixels_of(picture.at(stamp)))
        captioned, plain = (whole[:240] for whole in pictures)
        colors, metres = np.array_split(pictures[0][240:], 2)
        self.assertEqual([colors[len(colors) // 2, at].argmax() for at in (0, -1)], [0, 2])  # red is near, blue far
        for half in (slice(0, 160), slice(160, 320)):
            self.assertGreater((metres[:, half].max(axis=2) < 100).sum(), 10)  # dark letters
        self.assertEqual([plain[0, 0].argmax(), plain[0, -1].argmax()], [0, 2])  # red, blue
        for half in (slice(0, 160), slice(160, 320)):
            self.assertEqual(len(np.unique(plain[:, half].reshape(-1, 3), axis=0)), 1)
            written = (captioned != plain).any(axis=2)[:, half]
            ys, xs = np.nonzero(written)
            self.assertGreater(len(ys), 200)
            self.assertLess(abs(ys.mean() - 120) + abs(xs.mean() - 80), 8)  # about the middle
            self.assertGreater(captioned[:, half][written].min(axis=1).max(), 240)  # white


def topics_of(display):
    """Topics that a display of rviz subscribes to; for a depth image also the camera_info beside it."""
    names = [display[key] for key in ('Image Topic', 'Color Image Topic', 'Depth Map Topic', 'Marker Topic', 'Topic')
             if isinstance(display.get(key), str) and display[key]]
    if display.get('Depth Map Topic'):
        names.append(display['Depth Map Topic'].rpartition('/')[0] + '/camera_info')
    return names


class RvizFileTest(GraphTest):
    def test_somebody_publishes_what_the_displays_want(self):
        with open(RVIZ_FILE) as file:
            displays = [display for display in yaml.safe_load(file)['Visualization Manager']['Displays']
                        if display.get('Enabled', True)]
        topics = [name for display in displays for name in topics_of(display)]
        self.assertGreaterEqual(set(topics), {'all_in_focus/image', 'all_in_focus/weights_color', 'all_in_focus/depth',
                                              'segmentation/image_color', 'segmentation/markers'})
        missing = lambda: {'/rig/' + t for t in topics} - {name for name, _ in rospy.get_published_topics('/rig')}
        self.assertTrue(wait_until(lambda: not missing()), missing())
        types = dict(rospy.get_published_topics('/rig'))
        for display in displays:
            for name in topics_of(display):
                kind = 'sensor_msgs/CameraInfo' if name.endswith('camera_info') else TYPES[display['Class']]
                self.assertEqual(types['/rig/' + name], kind, display['Name'])


class DescriptionTest(GraphTest):
    GROUPS = {
        'depth_preprocess': {'Registration': ['mode'], 'Holes': ['fill_holes']},
        'segmenter': {'Optics': ['focal_length_mm', 'aperture', 'circle_of_confusion_mm'],
                      'Regions': ['dof_rule', 'min_region_size'], 'Captions': ['caption_min_area']},
        'fusion': {'Fusion': ['mode'], 'Alignment': ['reference', 'max_held_frames'],
                   'Brackets': ['bracket_mode', 'bracket_size', 'bracket_gap'],
                   'Labels': ['label_max_age', 'label_timeout']},
    }
    MODES = {'depth_preprocess': ['paper', 'refined'], 'fusion': ['paper', 'refined', 'restored']}
    CHOICES = {'dof_rule': ['paper', 'full'], 'bracket_mode': ['bracket', 'sliding']}

    def last(self, topic, kind):
        listener = self.listen(topic, kind)
        self.assertTrue(wait_until(lambda: listener.messages), topic)
        return listener.messages[-1]

    @staticmethod
    def values(config):
        parts = (config.bools, config.ints, config.strs, config.doubles)
        return {value.name: value.value for value in itertools.chain(*parts)}

    def test_every_parameter_has_group_unit_and_range(self):
        for node, groups in self.GROUPS.items():
            description = self.last(f'/rig/{node}/parameter_descriptions', ConfigDescription)
            shown = {group.name: group.parameters for group in description.groups if group.parameters}
            self.assertEqual({name: [p.name for p in parameters] for name, parameters in shown.items()}, groups, node)
            default, least, most = (self.values(part) for part in (description.dflt, description.min, description.max))
            for parameter in itertools.chain(*shown.values()):
                self.assertRegex(parameter.description, r'.{10,}\[.+\]', parameter.name)  # what it does, its unit
                if parameter.type in ('int', 'double'):
                    self.assertLessEqual(least[parameter.name], default[parameter.name])
                    self.assertGreater(most[parameter.name], default[parameter.name])
                    self.assertLess(most[parameter.name], 1e6)  # sliders stay usable
                wanted = self.MODES[node] if parameter.name == 'mode' else self.CHOICES.get(parameter.name)
                if wanted:
                    choices = [c['value'] for c in ast.literal_eval(parameter.edit_method)['enum']]
                    self.assertEqual(choices, wanted)
                    self.assertIn(default[parameter.name], choices)

    def test_nodes_start_with_the_defaults_shown(self):
        for node in self.GROUPS:
            default = self.last(f'/rig/{node}/parameter_descriptions', ConfigDescription).dflt
            now = self.last(f'/rig/{node}/parameter_updates', Config)
            self.assertEqual(self.values(now), self.values(default), node)


if __name__ == '__main__':
    run_tests(__file__)
