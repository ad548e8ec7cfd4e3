# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of the Kinect node share: cameras without hardware (test/openni2), plugged in and out."""
import atexit
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import cv2
import numpy as np
import rospy
from roslib.packages import find_node
from sensor_msgs.msg import CameraInfo, Image

from depth_testing import TIMEOUT, GraphTest, wait_until
from test_recorded_sample import SWEEP

WIDTH, HEIGHT = 640, 480
CAMERAS = Path(os.environ['KINECT_TEST_DIR'])  # of this .test file alone
SAMPLE = SWEEP / 'depth_raw.png'  # a Kinect's own depth
SENSORS = {'ir': 1, 'kinect_rgb': 2, 'depth': 3}
X, Y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
CAMERAS.mkdir(exist_ok=True)
atexit.register(shutil.rmtree, str(CAMERAS), True)


def plug(name, faults=''):
    """Also changes the faults of a camera that is plugged in."""
    new = CAMERAS / ('.new_' + name)
    new.write_text(faults)
    new.rename(CAMERAS / name)


def unplug(name):
    (CAMERAS / name).unlink()


def is_running(name, topic):
    return (CAMERAS / f'.{name}.{SENSORS[topic]}').exists()


def recorded_depth():
    """Of a real Kinect, 640x480 mm; None without it."""
    return cv2.imread(str(SAMPLE), cv2.IMREAD_UNCHANGED) if SAMPLE.is_file() else None


def depth_pattern(index):
    return (400 + (X + 2 * Y + 10 * index) % 3000).astype(np.uint16)


def index_of(depth):
    """Which image of the pattern this is, by a pixel of its last row that has not been cleared as invalid."""
    column = int(np.flatnonzero(depth[-1])[-1])
    offset = (int(depth[-1, column]) - 400 - column - 2 * (HEIGHT - 1)) % 3000
    assert offset % 10 == 0, offset
    return offset // 10


class Images:
    """The messages of a topic with the times at which they came."""

    def __init__(self, topic, message_type=Image):
        self.messages, self.times = [], []
        self.subscriber = rospy.Subscriber(topic, message_type, self.take, queue_size=100, buff_size=2 ** 24)

    def take(self, message):
        self.times.append(time.time())
        self.messages.append(message)

    def wait(self, count, timeout=TIMEOUT):
        """At least so many more messages, or an AssertionError."""
        begin = len(self.messages)
        if not wait_until(lambda: len(self.messages) >= begin + count, timeout):
            raise AssertionError(f'{len(self.messages) - begin} of {count} images came')
        return self.messages[begin:]

    def stamps(self):
        return np.array([message.header.stamp.to_sec() for message in self.messages])

    def delays(self):
        """s from the stamps to the arrivals. The least one tells of the stamps, the others of what else the computer does."""
        return np.array(self.times) - self.stamps()

    def close(self):
        self.subscriber.unregister()


class KinectNode:
    """/own/kinect_openni2 for a test that starts and ends it."""

    def __init__(self, *arguments, **environment):
        program = find_node('all_in_focus', 'kinect_openni2')[0]
        self.process = subprocess.Popen([program, '__ns:=/own', '_reconnect_period:=0.2', '_diagnostic_period:=0.05',
                                         *arguments],
                                        env=dict(os.environ, **environment), stdout=subprocess.PIPE,
                                        stderr=subprocess.STDOUT, universal_newlines=True)

    def stop(self):
        """What it said; an AssertionError if it ended in any other way than it was told to."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        output = self.process.communicate(timeout=TIMEOUT)[0]
        assert self.process.returncode == 0, output
        return output


class KinectTest(GraphTest):
    def setUp(self):
        super().setUp()
        self.unplug_all()

    def tearDown(self):
        super().tearDown()
        self.unplug_all()
        time.sleep(0.1)  # a camera that is back within 20 ms was never away

    def unplug_all(self):
        for file in CAMERAS.iterdir():
            if file.is_file() and not file.name.startswith('.'):
                file.unlink()

    def images(self, topic, message_type=Image):
        self.listeners.append(Images(topic, message_type))
        return self.listeners[-1]

    def infos(self, topic):
        return self.images(topic, CameraInfo)

    def status(self, node, text):
        return self.diagnostics.wait(node, lambda s: text in s.message)
