# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Opens a bag, finds its topics by their types, checks what the nodes need, reads its messages; its errors are one line."""
import struct
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import genpy
import rosbag
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from tf2_msgs.msg import TFMessage

from all_in_focus.image_messages import ImageError, bgr, color_message
from all_in_focus.files import yaml_file
from all_in_focus.files.errors import one_line
from all_in_focus.files.input_file import require_regular
from all_in_focus.msg import FocusFrame, Optics


class BagError(ValueError):
    """A bag that cannot be used; the message is one line and says why."""


@dataclass
class Topics:
    """Names of the topics in the bag, by kind."""
    depth: str = "/depth/image_raw"
    depth_info: str = "/depth/camera_info"
    rgb: str = "/rgb/image"
    rgb_info: str = "/rgb/camera_info"
    focus: str = "/rgb/focus"
    optics: str = "/rgb/optics"


def load_topics(path):
    """Topics of a YAML file that save_topics() has written; those that it leaves out keep their default. BagError."""
    data = yaml_file.read(path, BagError)
    known = {f"{kind}_topic": kind for kind in vars(Topics())}
    if not isinstance(data, dict) or not all(name in known and isinstance(topic, str) for name, topic in data.items()):
        raise BagError(f"{path}: expected lines such as depth_topic: /camera/depth/image_raw, with {', '.join(known)}")
    return Topics(**{known[name]: topic for name, topic in data.items()})


def save_topics(path, topics):
    """topics: names by kind."""
    yaml_file.write(path, {f"{kind}_topic": name for kind, name in topics.items()})


TYPES = {"depth": Image, "depth_info": CameraInfo, "rgb": Image, "rgb_info": CameraInfo, "focus": FocusFrame, "optics": Optics}
REQUIRED = {"depth": "depth image", "depth_info": "camera info of the depth camera", "rgb": "colour image",
            "rgb_info": "camera info of the colour camera"}
# What rosbag raises for damaged files; some of it comes from its decompressors.
DAMAGE = (rosbag.ROSBagException, genpy.DeserializationError, struct.error, RuntimeError, EOFError, ValueError,
          KeyError, IndexError, UnicodeError, MemoryError)


class BagFile:
    """An opened bag.

    topics: absolute names by kind (the fields of Topics); for colour the /compressed topic where there is no other.
    found: msg_type and message_count of each topic of the bag, by absolute name.
    """

    def __init__(self, path, topics=None):
        self.path = path
        self.topics = {kind: absolute(name) for kind, name in vars(topics or Topics()).items()}
        self._bag = self._open()
        info = self._bag.get_type_and_topic_info()
        self.found = {absolute(name): topic for name, topic in info.topics.items()}
        self._types = self._types_of_topics()
        compressed = f"{self.topics['rgb']}/compressed"
        if self.topics["rgb"] not in self.found and compressed in self.found:
            self.topics["rgb"] = compressed

    def close(self):
        self._bag.close()

    def has(self, kind):
        return self.has_topic(self.topics[kind])

    def has_topic(self, name):
        return name in self.found and self.found[name].message_count > 0

    def read(self, names, **options):
        """Messages of these topics in recorded order; options: of rosbag.Bag.read_messages()."""
        try:
            yield from self._bag.read_messages(topics=[*names, *(name[1:] for name in names)], **options)
        except (OSError, *DAMAGE) as error:
            raise BagError(f"{self.path}: damaged or unreadable: {one_line(error)}")

    def read_at(self, place):
        """The message at this place of the file, as read(raw=True) tells it."""
        try:
            return self._bag._read_message(place).message
        except (OSError, *DAMAGE) as error:
            raise BagError(f"{self.path}: damaged or unreadable: {one_line(error)}")

    def first(self, name):
        """(message, time) of a topic that has() one."""
        for _, message, time in self.read([name]):
            return message, time
        raise BagError(f"{self.path}: no message on {name} can be read")

    def missing(self):
        """Kinds that the nodes need and the bag lacks."""
        return [kind for kind in REQUIRED if not self.has(kind)]

    def wrong_types(self):
        """Yields (kind, one line) for topics of another type, of several, or of another version of the message."""
        for kind, expected in TYPES.items():
            name, found = self.topics[kind], self._types.get(self.topics[kind], set())
            known = {(one._type, one._md5sum) for one in (expected, *([CompressedImage] if kind == "rgb" else []))}
            if len(found) > 1 or found - known:
                held = " and ".join(sorted({datatype for datatype, _ in found}))
                yield kind, f"{name} holds {held}, not {expected._type} as it is today, of one publisher"

    def alternatives(self, kind):
        """Names of topics that have messages of the type that this kind needs."""
        types = (TYPES[kind]._type,) + ((CompressedImage._type,) if TYPES[kind] is Image else ())
        return sorted(name for name, info in self.found.items() if info.msg_type in types and info.message_count > 0)

    def _types_of_topics(self):
        """topic -> its types, with the checksums of their definitions. rosbag's own list knows one type of each topic."""
        found = {}

        def note(topic, datatype, md5sum, *_):
            found.setdefault(absolute(topic), set()).add((datatype, md5sum))
        for _ in self._bag.read_messages(connection_filter=note):  # no connection passes
            pass
        return found

    def _open(self):
        if Path(self.path).is_dir():
            raise BagError(f"{self.path}: is a folder, not a bag of ROS 1")
        try:
            require_regular(self.path)
            bag = rosbag.Bag(str(self.path))
            # rosbag takes messages to be stored in the order of their times. Recorders that buffer by topic do not.
            for index in bag._get_indexes(None):
                index.sort()
            return bag
        except rosbag.ROSBagUnindexedException:
            raise BagError(f"{self.path}: has no index (recording or copy cut off?): try rosbag reindex")
        except OSError as error:
            raise BagError(f"{self.path}: {error.strerror or error}")
        except UnicodeDecodeError:  # its first line is no text
            raise BagError(f"{self.path}: not a bag of ROS 1")
        except DAMAGE as error:
            raise BagError(f"{self.path}: not a bag of ROS 1: {one_line(error)}")


class BagContents(BagFile):
    """An opened bag that has everything the nodes need.

    start: time of the first message; counts: messages by kind; optics: the first Optics message or None;
    depth_info, rgb_info: the first ones; static_transforms: all of /tf_static in one message.
    problems: one line for each message that messages() left out.
    """

    def __init__(self, path, topics=None, transforms=True):
        """transforms: whether the bag itself must connect the cameras."""
        super().__init__(path, topics)
        self.problems = []
        for kind in self.missing():
            others = ", ".join(self.alternatives(kind))
            raise BagError(f"{self.path}: no {REQUIRED[kind]}: nothing on {self.topics[kind]}"
                           + (f" (there are {others})" if others else ""))
        for _, problem in self.wrong_types():
            raise BagError(f"{self.path}: {problem}")
        self.counts = {kind: self.found[name].message_count for kind, name in self.topics.items() if name in self.found}
        self.start = min(self.first(self.topics[kind])[1] for kind in ("depth", "rgb"))
        self.depth_info = self.first(self.topics["depth_info"])[0]
        self.rgb_info = self.first(self.topics["rgb_info"])[0]
        self.optics = self.first(self.topics["optics"])[0] if self.counts.get("optics") else None
        by_child = {}  # all in one message: a latched topic repeats only the last message of each publisher
        for _, message, _ in self.read(["/tf_static"]):
            by_child.update((transform.child_frame_id, transform) for transform in message.transforms)
        self.static_transforms = TFMessage(list(by_child.values()))
        if transforms:
            self._check_transforms()

    def messages(self):
        """Yields (kind, message, time) in recorded order; kinds are those of Topics, and "tf". Colour is decoded."""
        kinds = {name: kind for kind, name in self.topics.items()}
        kinds["/tf"] = "tf"
        for name, message, time in self.read(list(kinds)):
            kind = kinds[absolute(name)]
            if kind == "rgb" and message._type == CompressedImage._type:
                try:
                    message = color_message(bgr(message, deep=True), message.header)
                except ImageError as error:
                    self.problems.append(f"{name}: image of {message.header.stamp.to_sec():.6f}: {error}")
                    continue
            yield kind, message, time

    def _check_transforms(self):
        """BagError unless tf connects both cameras."""
        depth_frame = self.first(self.topics["depth"])[0].header.frame_id.lstrip("/")
        rgb_frame = self.rgb_info.header.frame_id.lstrip("/")
        above = {}  # frames that are connected have the same topmost one

        def top(name):
            while above.get(name, name) != name:
                name = above[name]
            return name

        for message in chain([self.static_transforms], (message for _, message, _ in self.read(["/tf"]))):
            for transform in message.transforms:
                above[top(transform.child_frame_id.lstrip("/"))] = top(transform.header.frame_id.lstrip("/"))
            if top(depth_frame) == top(rgb_frame):
                return
        if not self.has_topic("/tf") and not self.has_topic("/tf_static"):
            raise BagError(f"{self.path}: no transform: nothing on /tf_static or /tf")
        raise BagError(f"{self.path}: no transform connects depth frame '{depth_frame}' with colour frame "
                       f"'{rgb_frame}'")


def absolute(name):
    """A topic's name with its slash: recorders write names with and without it."""
    return f"/{name.strip('/')}"
