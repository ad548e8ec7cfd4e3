#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""After kill -9 of any process of robot.launch results are right again; the log tells after how many seconds."""
import time

import numpy as np
import rospy
from sensor_msgs.msg import Image

from depth_testing import run_tests, wait_until
from process_testing import kill, pid_of
from robot_testing import TIMEOUT, LaunchTest, Scene, whole

PROCESSES = ('all_in_focus_manager', 'kinect_openni2', 'depth_preprocess', 'segmenter', 'fusion', 'image_folder_camera',
             'rig_publisher')


class RobotRespawnTest(LaunchTest):
    def replaced_and(self, process, right):
        """Kills a process; right(): whether results are right that began after it was replaced."""
        begun, killed = time.monotonic(), kill('/' + process)
        self.assertTrue(wait_until(lambda: pid_of('/' + process) not in (None, killed), TIMEOUT), process + ' stays dead')
        self.assertTrue(wait_until(right(rospy.Time.now()), TIMEOUT),
                        f'{process} was killed: no right result within {TIMEOUT:.0f} s\n{"".join(self.launched.lines)}')
        rospy.loginfo('%s was killed: right again after %.1f s', process, time.monotonic() - begun)

    def test_with_recordings(self):
        scene = Scene(self.folder / 'scene')
        scene.record()
        expected, results = scene.fused(), self.results()
        self.launch('all_in_focus', 'robot.launch', rviz='false', frame_rate=10.0, **scene.arguments())
        self.assert_same(self.result(results, whole)[0], expected)

        def right_since(start):
            def right():
                found = results.find(lambda report: whole(report) and report.header.stamp > start)
                return found is not None and np.array_equal(found[0], expected)
            return right
        for process in PROCESSES:
            self.replaced_and(process, right_since)
            time.sleep(3)  # a nodelet whose loader was killed is loaded anew by then
            self.assertTrue(wait_until(right_since(rospy.Time.now()), TIMEOUT), process)

    def test_with_a_depth_image_and_without_a_dslr(self):
        """The node of the DSLR has no camera here: it only has to be there again."""
        scene, labels = Scene(self.folder / 'scene'), []
        subscriber = rospy.Subscriber('/segmentation/labels', Image, labels.append)
        self.addCleanup(subscriber.unregister)
        self.launch('all_in_focus', 'robot.launch', rviz='false', kinect=scene.depth, rig=scene.rig)
        self.assertTrue(wait_until(lambda: labels, TIMEOUT), ''.join(self.launched.lines))
        first = labels[0].data
        for process in ('depth_file_camera', 'focus_bracket_camera'):
            self.assertTrue(wait_until(lambda: pid_of('/' + process), TIMEOUT))
            self.replaced_and(process, lambda start: lambda: any(
                image.data == first for image in list(labels) if image.header.stamp > start))


if __name__ == '__main__':
    run_tests(__file__)
