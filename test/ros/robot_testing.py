# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of robot.launch share: scenes as recordings, what fuse_stack makes of them, and roslaunch itself."""
import os
import shutil
import signal
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np
import rospy
from sensor_msgs.msg import Image

from all_in_focus.msg import FusionReport
from depth_testing import wait_until
from fusion_testing import array_of
from process_testing import Talkative
from tool_helpers import MadeScene, read, write

WORLD = Path(os.environ['KINECT_TEST_WORLD'])
FRAMES = 5  # of the sweep
RECORDED = 12  # depth images; the recorder loses the first
TIMEOUT = 60.0  # s; a machine may have much else to do


class Scene(MadeScene):
    """With its depth as recording.oni."""

    def __init__(self, folder):
        super().__init__(folder, FRAMES)
        self.recording = folder / 'recording.oni'

    def copy_upside_down(self, folder):
        """Another scene, at less cost than making one."""
        shutil.copytree(self.folder, folder)
        for path in [folder / 'depth.png', *(folder / 'stack').iterdir()]:
            write(path, read(path)[::-1])
        return Scene(folder)

    def record(self):
        """With OpenNI2's own recorder, from a camera that shows the depth image."""
        cameras, pixels = self.folder / 'cameras', self.folder / 'depth.raw'
        cameras.mkdir()
        read(self.depth).tofile(str(pixels))
        (cameras / 'scene').write_text(f'recorded={pixels}')
        environment = dict(os.environ, KINECT_TEST_DIR=str(cameras), LD_LIBRARY_PATH=str(WORLD))
        subprocess.run([str(WORLD / 'record_oni'), 'frames:scene', str(self.recording), str(RECORDED), '0'], check=True,
                       timeout=TIMEOUT, env=environment)

    def arguments(self):
        """For robot.launch."""
        return {'kinect': self.recording, 'dslr': self.stack, 'focus': self.focus, 'rig': self.rig}


class Launch(Talkative):
    """roslaunch, on the master of the test."""

    def __init__(self, *files, **arguments):
        super().__init__(['roslaunch', *files, *(f'{name}:={value}' for name, value in arguments.items())],
                         PATH='/usr/bin:/bin:' + os.environ['PATH'])


class Results:
    """Fused images of a rig, with their reports."""

    def __init__(self, namespace=''):
        self._images, self._reports = {}, []
        self._subscribers = [
            rospy.Subscriber(namespace + '/all_in_focus/image', Image,
                             lambda image: self._images.setdefault(image.header.stamp, image), buff_size=2 ** 24),
            rospy.Subscriber(namespace + '/all_in_focus/report', FusionReport, self._reports.append)]

    def find(self, accept):
        """(picture as BGR, report) of the newest result whose report is accepted; None without one."""
        report = next((report for report in reversed(self._reports)
                       if report.header.stamp in self._images and accept(report)), None)
        if report is None:
            return None
        image = self._images[report.header.stamp]
        picture = array_of(image)
        return (picture if image.encoding == 'bgr8' else picture[..., ::-1]), report

    def wait(self, accept):
        """As find(), None if it does not come."""
        return wait_until(lambda: self.find(accept), TIMEOUT)

    def close(self):
        for subscriber in self._subscribers:
            subscriber.unregister()


class LaunchTest(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, str(self.folder), True)
        self.launched = None

    def launch(self, *files, **arguments):
        self.launched = Launch(*files, **arguments)
        self.addCleanup(self.launched.stop, signal.SIGINT)

    def results(self, namespace=''):
        results = Results(namespace)
        self.addCleanup(results.close)
        return results

    def result(self, results, accept):
        """See Results.wait; fails with what was printed instead."""
        found = results.wait(accept)
        self.assertIsNotNone(found, ''.join(self.launched.lines))
        return found

    def assert_said(self, *words):
        for some in words:
            self.assertIsNotNone(self.launched.said(some),
                                 f'{some!r} is missing in\n{"".join(self.launched.lines)}')

    def assert_same(self, picture, expected):
        np.testing.assert_array_equal(picture, expected)


def whole(report):
    """Whether a bracket was fused from its first to its last frame, with its regions."""
    return report.has_labels and report.frames_seen == FRAMES
