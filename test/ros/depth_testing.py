# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of the depth nodes share: a scene of two planes, and patient talking and listening."""
import os
import sys
import unittest
import xmlrpc.client
from pathlib import Path

import numpy as np
import rosgraph
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from all_in_focus.msg import SegmentArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # for all that import this
from file_helpers import wait_until  # noqa: E402

WIDTH, HEIGHT = 64, 48
NEAR_MM, FAR_MM = 1000, 3000
OK, WARN, ERROR = 0, 1, 2  # levels of diagnostics
SANITIZED = bool(os.environ.get('SANITIZED_PREFIX'))  # nodes are compiled with a sanitizer, and many times slower
TIMEOUT = 50.0  # s; long: a computer with much else to do is slow, and what comes is taken at once
ENCODINGS = {'16UC1': np.uint16, 'mono16': np.uint16, '32FC1': np.float32, '32SC1': np.int32, 'rgb8': np.uint8,
             'bgr8': np.uint8}


def two_planes(width=WIDTH, height=HEIGHT):
    """Left half near, right half far [mm]."""
    depth = np.full((height, width), FAR_MM, np.uint16)
    depth[:, :width // 2] = NEAR_MM
    return depth


def image_message(pixels, stamp, encoding='16UC1', frame='depth'):
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding=encoding, data=pixels.tobytes())
    message.step = pixels.strides[0]
    message.header.stamp, message.header.frame_id = rospy.Time.from_sec(stamp), frame
    return message


def pixels_of(message):
    flat = np.frombuffer(message.data, ENCODINGS[message.encoding])
    channels = (3,) if message.encoding in ('rgb8', 'bgr8') else ()
    return flat.reshape((message.height, message.width, *channels))


def camera_info(stamp, frame, focal_px=50.0, model='plumb_bob'):
    info = CameraInfo(width=WIDTH, height=HEIGHT, distortion_model=model, D=[0.0] * 5)
    info.K = [focal_px, 0, WIDTH / 2, 0, focal_px, HEIGHT / 2, 0, 0, 1 if focal_px else 0]
    info.header.stamp, info.header.frame_id = rospy.Time.from_sec(stamp), frame
    return info


def transform(child, translation=(0, 0, 0), rotation=(0, 0, 0, 1)):
    """Pose of a frame in that of the colour camera, as a message of /tf."""
    pose = Transform(Vector3(*translation), Quaternion(*rotation))
    return TransformStamped(Header(frame_id='color'), child, pose)


class Talker:
    """Publishes as soon as somebody is there to hear."""

    def __init__(self, topic, message_type):
        self.publisher = rospy.Publisher(topic, message_type, queue_size=100)
        self.topic = self.publisher.resolved_name

    def wait_for(self, nodes):
        if not wait_until(lambda: self.publisher.get_num_connections() >= nodes):
            raise AssertionError(f'fewer than {nodes} subscribe {self.topic}')

    def say(self, message):
        self.wait_for(1)
        self.publisher.publish(message)

    def close(self):
        # Nodes stop listening a moment after nobody listens to them: not to be taken for listeners by the next test.
        wait_until(lambda: not subscribers_of(self.topic))
        self.publisher.unregister()


class Listener:
    """All messages of a topic by stamp, in order of arrival."""

    def __init__(self, topic, message_type):
        self.messages = []
        self.subscriber = rospy.Subscriber(topic, message_type, self.messages.append)  # no queue_size: none is lost
        # rospy counts a connection before it is made; one that is closed before that may stay.
        wait_until(lambda: any(connection.socket for connection in self.subscriber.impl.connections))

    def at(self, stamp, timeout=TIMEOUT):
        """The message with this stamp, None if it does not come."""
        wanted = rospy.Time.from_sec(stamp)
        found = lambda: next((m for m in self.messages if getattr(m, 'header', m).stamp == wanted), None)
        return wait_until(found, timeout)

    def close(self):
        self.subscriber.unregister()


class Diagnostics:
    """What the nodes say of themselves."""

    def __init__(self):
        self.statuses = []
        self.subscriber = rospy.Subscriber('/diagnostics', DiagnosticArray,
                                           lambda array: self.statuses.extend(array.status))

    def next(self, node):
        """The next status of a node."""
        return self.wait(node, lambda status: True)

    def wait(self, node, accept):
        """The next status of a node that is accepted; fails with what came instead."""
        seen = len(self.statuses)
        matching = lambda: [s for s in self.statuses[seen:] if s.name.startswith(node + ':')]
        found = wait_until(lambda: next((s for s in matching() if accept(s)), None))
        if found is None:
            raise AssertionError(f'{node} said {sorted({(s.level, s.message) for s in matching()})}')
        return found

    def close(self):
        self.subscriber.unregister()


class GraphTest(unittest.TestCase):
    """Leaves the nodes idle behind it."""

    def setUp(self):
        self.talkers, self.listeners = [], []
        self.diagnostics = Diagnostics()

    def tearDown(self):
        for one in [self.diagnostics, *self.listeners, *self.talkers]:
            one.close()

    def talk(self, topic, message_type):
        self.talkers.append(Talker(topic, message_type))
        return self.talkers[-1]

    def listen(self, topic, message_type):
        self.listeners.append(Listener(topic, message_type))
        return self.listeners[-1]

    def deliver(self, node, *messages):
        """Says messages, (talker, message) each, and returns when the node has taken them. What is said on another topic
        after that comes after them."""
        talkers = {talker.topic: talker for talker, _ in messages}
        taken = lambda status: {topic: int(values_of(status)[topic].split()[0]) for topic in talkers}
        wanted = taken(self.diagnostics.wait(node, lambda status: 'nobody listens' not in status.message))
        for talker in talkers.values():  # the node listens now, perhaps not the only one
            talker.wait_for(len(subscribers_of(talker.topic)))
        for talker, message in messages:
            talker.say(message)
            wanted[talker.topic] += 1
        self.diagnostics.wait(node, lambda status: all(count >= wanted[topic] for topic, count in taken(status).items()))

    def send_depth(self, stamp, pixels=None, encoding='16UC1', frame='depth', **infos):
        """By self.depth, after the camera infos, by self.infos: they hold for the depth."""
        infos = {'depth': camera_info(stamp, 'depth'), 'rgb': camera_info(stamp, 'color'), **infos}
        node = self.depth.topic[1:].replace('depth/image_raw', 'depth_preprocess')
        self.deliver(node, *((self.infos[name], info) for name, info in infos.items()))
        self.depth.say(image_message(two_planes() if pixels is None else pixels, stamp, encoding, frame))


class AloneTest(GraphTest):
    """A segmenter on its own."""

    def setUp(self):
        super().setUp()
        self.depth = self.talk('/alone/depth_registered/image', Image)
        self.labels = self.listen('/alone/segmentation/labels', Image)
        self.segments = self.listen('/alone/segmentation/segments', SegmentArray)


def values_of(status):
    return {pair.key: pair.value for pair in status.values}


def subscribers_of(topic):
    """As the ROS master sees them."""
    return next((nodes for name, nodes in rosgraph.Master('/test').getSystemState()[1] if name == topic), [])


def hears(node, topic):
    """Whether the node is connected to a publisher of the topic."""
    try:
        with xmlrpc.client.ServerProxy(rosgraph.Master('/test').lookupNode(node)) as proxy:
            _, _, connections = proxy.getBusInfo('/test')
    except (rosgraph.MasterException, OSError, xmlrpc.client.Error):
        return False
    return any(direction == 'i' and connected and name == topic for _, _, direction, _, name, connected, *_ in connections)


def run_tests(file):
    """Runs the tests of a file, as a node of its name: the last line of each."""
    name = Path(file).stem
    rospy.init_node(name)
    rostest.rosrun('all_in_focus', name[:-len('_test')], '__main__')
