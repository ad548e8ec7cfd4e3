# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A bag as input of the nodes: is everything there, and the messages in order under the names of the graph."""
import os
import struct
from dataclasses import dataclass

import cv2
import cv_bridge
import rosbag
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from tf2_msgs.msg import TFMessage

from all_in_focus.msg import FocusFrame, Optics


class BagError(ValueError):
    """A bag that cannot be used; the message is one line and says what is missing."""


@dataclass
class Topics:
    """Names in the bag, by what they hold."""
    depth: str = "/depth/image_raw"
    depth_info: str = "/depth/camera_info"
    rgb: str = "/rgb/image"
    rgb_info: str = "/rgb/camera_info"
    focus: str = "/rgb/focus"
    optics: str = "/rgb/optics"


TYPES = {"depth": Image, "depth_info": CameraInfo, "rgb": Image, "rgb_info": CameraInfo, "focus": FocusFrame,
         "optics": Optics}
REQUIRED = {"depth": "depth image", "depth_info": "camera info of the depth camera", "rgb": "colour image",
            "rgb_info": "camera info of the colour camera"}
# What rosbag throws at damaged files, from its own errors down to those of its decompressors.
DAMAGE = (rosbag.ROSBagException, struct.error, RuntimeError, EOFError, ValueError, KeyError, IndexError, UnicodeError,
          MemoryError)


class BagContents:
    """An opened bag that holds everything the nodes need.

    start: time of the first message; counts: messages by kind; optics: the first Optics message or None;
    depth_info, rgb_info: the first ones; static_transforms: all of /tf_static in one message.
    problems: one line for each message that messages() had to leave out.
    """

    def __init__(self, path, topics=None):
        self.path = path
        self._topics = {kind: _absolute(name) for kind, name in vars(topics or Topics()).items()}
        self._bag = self._open()
        self._bridge = cv_bridge.CvBridge()
        self.problems = []
        info = self._bag.get_type_and_topic_info()
        self._found = {_absolute(name): topic for name, topic in info.topics.items()}
        self._md5sums = info.msg_types
        self._check_topics()
        self.counts = {kind: self._found[name].message_count for kind, name in self._topics.items()
                       if name in self._found}
        self.start = self._first(self._topics["depth"])[1]
        self.start = min(self.start, self._first(self._topics["rgb"])[1])
        self.depth_info = self._first(self._topics["depth_info"])[0]
        self.rgb_info = self._first(self._topics["rgb_info"])[0]
        self.optics = self._first(self._topics["optics"])[0] if self.counts.get("optics") else None
        self.static_transforms = self._collect_static_transforms()
        self._check_transforms()

    def close(self):
        self._bag.close()

    def messages(self):
        """Yield (kind, message, time) in recorded order; kinds are those of Topics, and "tf". Colour is decoded."""
        kinds = {name: kind for kind, name in self._topics.items()}
        kinds["/tf"] = "tf"
        for name, message, time in self._read(list(kinds)):
            kind = kinds[_absolute(name)]
            if kind == "rgb" and message._type == CompressedImage._type:
                message = self._decoded(message, name)
            if message is not None:
                yield kind, message, time

    def _open(self):
        try:
            if os.path.isdir(self.path):
                raise BagError("%s: is a folder, not a bag" % self.path)
            return rosbag.Bag(self.path)
        except rosbag.ROSBagUnindexedException:
            raise BagError("%s: has no index (recording or copy cut off?): try rosbag reindex" % self.path)
        except OSError as error:
            raise BagError("%s: %s" % (self.path, error.strerror or error))
        except BagError:
            raise
        except DAMAGE as error:
            raise BagError("%s: not a bag: %s" % (self.path, _one_line(error)))

    def _read(self, names):
        try:
            yield from self._bag.read_messages(topics=names + [name[1:] for name in names])
        except (OSError, *DAMAGE) as error:
            raise BagError("%s: damaged or unreadable: %s" % (self.path, _one_line(error)))

    def _first(self, name):
        for _, message, time in self._read([name]):
            return message, time
        raise BagError("%s: no message on %s can be read" % (self.path, name))

    def _check_topics(self):
        compressed = self._topics["rgb"] + "/compressed"
        if self._topics["rgb"] not in self._found and compressed in self._found:
            self._topics["rgb"] = compressed
        for kind, meaning in REQUIRED.items():
            if not self._has(self._topics[kind]):
                raise BagError("%s: no %s: nothing on %s%s"
                               % (self.path, meaning, self._topics[kind], self._alternatives(TYPES[kind])))
        for kind, expected in TYPES.items():
            found = self._found.get(self._topics[kind])
            if found is None or kind == "rgb" and found.msg_type == CompressedImage._type:
                continue
            if found.msg_type != expected._type:
                raise BagError("%s: %s holds %s, not %s"
                               % (self.path, self._topics[kind], found.msg_type, expected._type))
            if self._md5sums.get(expected._type) != expected._md5sum:
                raise BagError("%s: %s: %s was recorded in another version of that message"
                               % (self.path, self._topics[kind], expected._type))

    def _has(self, name):
        return name in self._found and self._found[name].message_count > 0

    def _alternatives(self, expected):
        types = (expected._type, CompressedImage._type) if expected is Image else (expected._type,)
        names = sorted(name for name, info in self._found.items() if info.msg_type in types)
        return " (there are %s)" % ", ".join(names) if names else ""

    def _collect_static_transforms(self):
        """A latched topic keeps one message only, and each publisher had its own: all go into one."""
        by_child = {}
        for _, message, _ in self._read(["/tf_static"]):
            by_child.update((transform.child_frame_id, transform) for transform in message.transforms)
        return TFMessage(list(by_child.values()))

    def _check_transforms(self):
        """Raise BagError unless tf connects both cameras."""
        depth_frame = self._first(self._topics["depth"])[0].header.frame_id.lstrip("/")
        rgb_frame = self.rgb_info.header.frame_id.lstrip("/")
        tree = _Frames(self.static_transforms.transforms)
        if tree.connected(depth_frame, rgb_frame):
            return
        if not self._has("/tf") and not self._has("/tf_static"):
            raise BagError("%s: no transform: nothing on /tf_static or /tf" % self.path)
        for _, message, _ in self._read(["/tf"]):
            tree.add(message.transforms)
            if tree.connected(depth_frame, rgb_frame):
                return
        raise BagError("%s: no transform connects depth frame '%s' with colour frame '%s'"
                       % (self.path, depth_frame, rgb_frame))

    def _decoded(self, message, name):
        try:
            image = self._bridge.compressed_imgmsg_to_cv2(message, "bgr8")
            return self._bridge.cv2_to_imgmsg(image, "bgr8", message.header)
        except (cv2.error, cv_bridge.CvBridgeError, ValueError, TypeError, AttributeError) as error:
            self.problems.append("%s: image of %.6f cannot be decoded: %s"
                                 % (name, message.header.stamp.to_sec(), _one_line(error)))
            return None


class _Frames:
    """Which frames hang together: sets merged by their transforms."""

    def __init__(self, transforms):
        self._root = {}
        self.add(transforms)

    def add(self, transforms):
        for transform in transforms:
            child, parent = (self._find(name.lstrip("/"))
                             for name in (transform.child_frame_id, transform.header.frame_id))
            self._root[child] = parent

    def connected(self, a, b):
        return self._find(a) == self._find(b)

    def _find(self, name):
        while self._root.setdefault(name, name) != name:
            name = self._root[name]
        return name


def _absolute(name):
    """Recorders write names with and without the slash."""
    return "/" + name.strip("/")


def _one_line(error):
    return " ".join(str(error).split()) or type(error).__name__
