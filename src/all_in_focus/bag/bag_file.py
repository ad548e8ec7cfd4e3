# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Opens a bag, finds its topics by their types and reads its messages; its errors are one line."""
import struct
from dataclasses import dataclass
from pathlib import Path

import genpy
import rosbag
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from all_in_focus.files.errors import one_line
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


TYPES = {"depth": Image, "depth_info": CameraInfo, "rgb": Image, "rgb_info": CameraInfo, "focus": FocusFrame,
         "optics": Optics}
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
        self._md5sums = info.msg_types
        compressed = f"{self.topics['rgb']}/compressed"
        if self.topics["rgb"] not in self.found and compressed in self.found:
            self.topics["rgb"] = compressed

    def close(self):
        self._bag.close()

    def has(self, kind):
        """Whether there is a message of that kind."""
        return self.has_topic(self.topics[kind])

    def has_topic(self, name):
        return name in self.found and self.found[name].message_count > 0

    def read(self, names, **options):
        """Messages of these topics in recorded order; options: of rosbag.Bag.read_messages()."""
        try:
            yield from self._bag.read_messages(topics=[*names, *(name[1:] for name in names)], **options)
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
        """Yields (kind, one line) for topics of another type."""
        for kind, expected in TYPES.items():
            name = self.topics[kind]
            found = self.found.get(name)
            if found is None or kind == "rgb" and found.msg_type == CompressedImage._type:
                continue
            if found.msg_type != expected._type:
                yield kind, f"{name} holds {found.msg_type}, not {expected._type}"
            elif self._md5sums.get(expected._type) != expected._md5sum:
                yield kind, f"{name}: {expected._type} was recorded in another version of that message"

    def alternatives(self, kind):
        """Names of topics that have messages of the type that this kind needs."""
        types = (TYPES[kind]._type,) + ((CompressedImage._type,) if TYPES[kind] is Image else ())
        return sorted(name for name, info in self.found.items() if info.msg_type in types and info.message_count > 0)

    def span(self):
        """First and last time of recording, s."""
        if not any(self.has_topic(name) for name in self.found):
            return 0.0, 0.0
        return self._bag.get_start_time(), self._bag.get_end_time()

    def compression(self):
        """none, bz2 or lz4."""
        return self._bag.get_compression_info().compression

    def _open(self):
        if Path(self.path).is_dir():
            raise BagError(f"{self.path}: is a folder, not a bag")
        try:
            return rosbag.Bag(str(self.path))
        except rosbag.ROSBagUnindexedException:
            raise BagError(f"{self.path}: has no index (recording or copy cut off?): try rosbag reindex")
        except OSError as error:
            raise BagError(f"{self.path}: {error.strerror or error}")
        except UnicodeDecodeError:  # its first line is no text
            raise BagError(f"{self.path}: not a bag")
        except DAMAGE as error:
            raise BagError(f"{self.path}: not a bag: {one_line(error)}")


def absolute(name):
    """A topic's name with its slash: recorders write names with and without it."""
    return f"/{name.strip('/')}"
