# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of all three nodes together share: a rig with both cameras, and brackets that are fused as they should."""
import itertools

import rospy
from dynamic_reconfigure.client import Client
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from all_in_focus.msg import SegmentArray
from depth_testing import OK, TIMEOUT, pixels_of, transform
from fusion_testing import FAR, NEAR, FusionTest, array_of, regions, scene

STAMPS = itertools.count(1000, 10)
OPTICS = {'focal_length_mm': 24.0, 'aperture': 4.0, 'circle_of_confusion_mm': 0.019}
NODES = ('depth_preprocess', 'segmenter', 'fusion')


class RigTest(FusionTest):
    RIG = '/rig'

    @classmethod
    def setUpClass(cls):
        cls.optics = Client('/rig/segmenter', timeout=TIMEOUT)
        cls.transforms = rospy.Publisher('/tf_static', TFMessage, queue_size=10, latch=True)
        cls.transforms.publish(TFMessage([transform('depth')]))

    def setUp(self):
        super().setUp()
        self.optics.update_configuration(OPTICS)
        self.depth = self.talk(self.topic('depth/image_raw'), Image)
        self.infos = {name: self.talk(self.topic(name + '/camera_info'), CameraInfo) for name in ('depth', 'rgb')}
        self.labels = self.listen(self.topic('segmentation/labels'), Image)
        self.segments = self.listen(self.topic('segmentation/segments'), SegmentArray)

    def assert_good_bracket_is_fused(self):
        """Registration may move the edge between the planes by a pixel. Returns labels, table and report."""
        stamp = next(STAMPS)
        self.send_depth(stamp)
        labels = self.labels.at(stamp)
        self.assertIsNotNone(labels)
        self.assertGreater((pixels_of(labels) == regions()).mean(), 0.95)
        middle = self.send_bracket(stamp)
        report = self.report(middle)
        self.assertEqual([report.has_labels, report.label_stamp], [True, rospy.Time.from_sec(stamp)])
        self.assertEqual([(s.label, s.frame) for s in report.segments], [(1, 1), (2, 2)])
        same = (array_of(self.outputs['image'].at(middle)) == scene()).all(axis=2)
        self.assertGreater(min(same[NEAR].mean(), same[FAR].mean()), 0.95)
        for node in NODES:
            self.diagnostics.wait('rig/' + node, lambda s: s.level == OK)
        return report
