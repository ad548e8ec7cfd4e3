# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of the fusion share: frames of which it is known where they are sharp, and a rig that sends them."""
import itertools

import numpy as np
import rosgraph
import rospy
from dynamic_reconfigure.client import Client
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from all_in_focus.msg import FocusFrame, FusionReport, Optics
from depth_testing import HEIGHT, NEAR_MM, TIMEOUT, WIDTH, GraphTest, image_message, two_planes, wait_until

NEAR, FAR = np.s_[:, :WIDTH // 2], np.s_[:, WIDTH // 2:]  # halves of the image
PERIOD = 0.125  # s between frames, exact in binary
OPTICS = Optics(focal_length_mm=24.0, aperture=4.0, circle_of_confusion_mm=0.019)
CHANNELS = {'bgr16': (np.uint16, 3),
            'bgr8': (np.uint8, 3), 'rgb8': (np.uint8, 3), 'mono8': (np.uint8, 1), '16UC1': (np.uint16, 1)}
OUTPUTS = {'image': Image, 'source_index': Image, 'confidence': Image, 'weights_color': Image, 'depth': Image,
           'camera_info': CameraInfo, 'report': FusionReport}
DEFAULTS = {'mode': 'paper', 'reference': -1, 'max_held_frames': 64, 'bracket_mode': 'bracket', 'bracket_size': 0,
            'bracket_gap': 0.0, 'label_max_age': 1.0, 'label_timeout': 2.0}
BRACKET_IDS = itertools.count(1)
CLIENTS = {}


def scene():
    """The scene, sharp all over: noise."""
    return np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


def blurred(picture):
    shifts = itertools.product(range(-2, 3), range(-2, 3))
    return np.mean([np.roll(picture.astype(float), shift, (0, 1)) for shift in shifts], axis=0).astype(np.uint8)


def picture(sharp):
    """sharp: 'near' (left half), 'far' (right half), 'both' or 'none'."""
    pixels = scene() if sharp == 'both' else blurred(scene())
    if sharp in ('near', 'far'):
        half = NEAR if sharp == 'near' else FAR
        pixels[half] = scene()[half]
    return pixels


def regions():
    """Label image of the two planes."""
    return np.where(two_planes() == NEAR_MM, 1, 2).astype(np.int32)


def colour_message(pixels, stamp, encoding='bgr8'):
    return image_message(np.ascontiguousarray(pixels), stamp, encoding, 'color')


def array_of(message):
    kind, channels = CHANNELS[message.encoding]
    return np.frombuffer(message.data, kind).reshape((message.height, message.width, channels)).squeeze()


def publishers_of(topic):
    return next((nodes for name, nodes in rosgraph.Master('/test').getSystemState()[0] if name == topic), [])


class FusionTest(GraphTest):
    """A camera that feeds one fusion node, and listeners to what comes out."""
    RIG = '/focus'

    @property
    def node(self):
        """As diagnostics name it."""
        return self.topic('fusion')[1:]

    def setUp(self):
        super().setUp()
        wait_until(lambda: self.diagnostics.subscriber.get_num_connections() >= len(publishers_of('/diagnostics')))
        self.reconfigure()
        self.outputs = {name: self.listen(self.topic('all_in_focus/' + name), OUTPUTS[name])
                        for name in ('report', 'image', 'source_index')}
        self.processed = self.listen(self.topic('all_in_focus/processed'), Header)
        self.image = self.talk(self.topic('rgb/image'), Image)
        if self.RIG != '/plain':
            self.focus = self.talk(self.topic('rgb/focus'), FocusFrame)

    def topic(self, name):
        return self.RIG + '/' + name

    def reconfigure(self, **config):
        """Sets what is named and resets the rest; returns what the node shows."""
        if self.RIG not in CLIENTS:
            CLIENTS[self.RIG] = Client(self.topic('fusion'), timeout=TIMEOUT)
        return CLIENTS[self.RIG].update_configuration({**DEFAULTS, **config})

    def finish(self):
        rospy.wait_for_service(self.topic('fusion/finish'), TIMEOUT)
        return rospy.ServiceProxy(self.topic('fusion/finish'), Trigger)()

    def expect_labels(self):
        """From here on a segmenter is there."""
        self.labels = self.talk(self.topic('segmentation/labels'), Image)
        self.assertTrue(wait_until(lambda: self.labels.publisher.get_num_connections() > 0))

    def labels_of(self, stamp, labels=None, encoding='32SC1'):
        """(talker, message)"""
        return self.labels, image_message(regions() if labels is None else labels, stamp, encoding, 'color')

    def send_labels(self, stamp, *labels, **options):
        talker, message = self.labels_of(stamp, *labels, **options)
        talker.say(message)

    def deliver_labels(self, stamp):
        """What is sent after that comes after them."""
        self.deliver(self.node, self.labels_of(stamp))

    def frame_of(self, stamp, sharp, **focus):
        """(talker, message) for the image and its FocusFrame. sharp: see picture(), or the message itself; focus: fields of the
        FocusFrame, none = there is none."""
        image = colour_message(picture(sharp), stamp) if isinstance(sharp, str) else sharp
        yield self.image, image
        if focus:
            yield self.focus, FocusFrame(**{'header': image.header, 'focus_distance': float('nan'), **focus})

    def send_frame(self, stamp, sharp, **focus):
        for talker, message in self.frame_of(stamp, sharp, **focus):
            talker.say(message)

    def bracket_of(self, stamp, frames=('none', 'near', 'far'), **focus):
        """(talker, message) for all frames, which are from `stamp` on."""
        focus = {'bracket_id': next(BRACKET_IDS), 'count': len(frames), **focus}
        for index, sharp in enumerate(frames):
            yield from self.frame_of(stamp + index * PERIOD, sharp, index=index, **focus)

    def send_bracket(self, stamp, frames=('none', 'near', 'far'), **focus):
        """Returns the stamp of the middle frame, which the result is to carry."""
        for talker, message in self.bracket_of(stamp, frames, **focus):
            talker.say(message)
        return stamp + len(frames) // 2 * PERIOD

    def acknowledged(self, stamp):
        self.assertIsNotNone(self.processed.at(stamp), f'frame {stamp} was not acknowledged')

    def report(self, stamp):
        report = self.outputs['report'].at(stamp)
        others = [other.header.stamp.to_sec() for other in self.outputs['report'].messages]
        self.assertIsNotNone(report, f'no report of {stamp}, but of {others}')
        return report

    def assert_noted(self, report, *words):
        self.assertTrue(any(all(word in note for word in words) for note in report.notes), (words, report.notes))

    def assert_fused(self, stamp, near=1, far=2):
        """By regions, the near half from frame `near`, the far half from frame `far`, where it is sharp. Returns the report."""
        report = self.report(stamp)
        self.assertTrue(report.has_labels, report.notes)
        self.assertEqual([(s.label, s.frame) for s in report.segments], [(1, near), (2, far)])
        index = array_of(self.outputs['source_index'].at(stamp))
        self.assertEqual([np.unique(index[half]).tolist() for half in (NEAR, FAR)], [[near], [far]])
        np.testing.assert_array_equal(array_of(self.outputs['image'].at(stamp)), scene())
        return report

    def assert_fused_by_sharpness(self, stamp, near=1, far=2):
        report = self.report(stamp)
        self.assertEqual([report.has_labels, report.sharpness_alone, list(report.segments)], [False, True, []])
        self.assert_noted(report, 'sharpness alone')
        index = array_of(self.outputs['source_index'].at(stamp))
        for half, frame in ((NEAR, near), (FAR, far)):
            # All but, at most, the column beside the edge; by chance a third.
            self.assertGreaterEqual((index[half] == frame).mean(), 1 - 2 / WIDTH)
        return report

    def assert_diagnosed(self, level, *words, node='fusion'):
        """The node said so since the test began."""
        name = self.topic(node).lstrip('/') + ':'
        matching = lambda: [s for s in self.diagnostics.statuses if s.name.startswith(name)]
        found = lambda: any(s.level == level and all(word in s.message for word in words) for s in matching())
        self.assertTrue(wait_until(found), (node, words, {(s.level, s.message) for s in matching()}))

    def assert_next_bracket_is_good(self, stamp):
        """stamp: a moment after all others of the test."""
        self.assert_fused(self.send_good_bracket(stamp))

    def send_good_bracket(self, stamp):
        if not hasattr(self, 'labels'):
            self.expect_labels()
        self.send_labels(stamp)
        return self.send_bracket(stamp)
