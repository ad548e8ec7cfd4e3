#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Drawing the regions for people fails: the labels are published all the same."""
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from depth_testing import ERROR, AloneTest, image_message, run_tests, two_planes, wait_until


class FaultyDrawingTest(AloneTest):
    def test_labels_are_published(self):
        self.listen('/alone/segmentation/image_color', Image)
        processed = self.listen('/alone/segmentation/processed', Header)
        self.depth.say(image_message(two_planes(), 1000))
        self.assertIsNotNone(self.labels.at(1000))
        self.assertEqual(len(self.segments.at(1000).segments), 2)
        self.assertIsNotNone(processed.at(1000))
        # The image was processed all the same: only one report tells of it, and it may have come by now.
        status = wait_until(lambda: next((s for s in self.diagnostics.statuses if s.level == ERROR), None))
        self.assertIsNotNone(status)
        self.assertRegex(status.message, '^labels are published, but not all that is drawn of them: .*for a drawing$')


if __name__ == '__main__':
    run_tests(__file__)
