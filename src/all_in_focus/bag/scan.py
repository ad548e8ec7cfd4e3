# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One pass over a bag that keeps the head of each image and all small messages. Pixels are fetched later."""
import zlib
from dataclasses import dataclass, field
from typing import List, NamedTuple, Optional

import genpy
from sensor_msgs.msg import CompressedImage
from tf2_msgs.msg import TFMessage

from all_in_focus.bag.bag_file import TYPES, absolute
from all_in_focus.image_messages import ImageError, bgr, check_depth
from all_in_focus.progress import Progress

NS = 10 ** 9  # in a second
SMALL = {**TYPES, "tf": TFMessage, "tf_static": TFMessage}  # tf2 does not accept the classes that rosbag generates


class Head(NamedTuple):
    """An image without its pixels. Times in ns.

    order: position among the messages scanned; place: in the file; size: (width, height), None of a compressed image that
    nobody has looked at; problem: why the nodes refuse it, else ""; checksum: of the pixels.
    """
    order: int
    recorded: int
    place: tuple
    stamp: int
    frame_id: str
    encoding: str
    size: Optional[tuple]
    problem: str
    checksum: int


class Small(NamedTuple):
    """A message that is kept; order: as of a Head."""
    order: int
    message: object


@dataclass
class Scan:
    """Content of a bag in recorded order. Of camera infos only those that differ from the one before.

    unreadable: (kind, recorded) of messages that cannot be deserialised; start: time of the first message, ns.
    """
    depth: List[Head] = field(default_factory=list)
    rgb: List[Head] = field(default_factory=list)
    depth_info: List[Small] = field(default_factory=list)
    rgb_info: List[Small] = field(default_factory=list)
    focus: List[Small] = field(default_factory=list)
    optics: List[Small] = field(default_factory=list)
    tf: List[Small] = field(default_factory=list)
    tf_static: List[Small] = field(default_factory=list)
    unreadable: List[tuple] = field(default_factory=list)
    counts: dict = field(default_factory=dict)
    start: int = 0


def scan(bag, pixels=False):
    """Scan of a BagFile; topics of a wrong type are left out. pixels: whether to look at those of every colour image, too."""
    wrong = {kind for kind, _ in bag.wrong_types()}
    kinds = {name: kind for kind, name in bag.topics.items() if kind not in wrong}
    kinds.update({"/tf": "tf", "/tf_static": "tf_static"})
    found = Scan()
    total = sum(bag.found[name].message_count for name in kinds if name in bag.found)
    infos = {}  # the last camera info by kind, without its stamp
    messages = enumerate(bag.read(list(kinds), raw=True))
    bar = Progress(messages, total=total, unit="message", leave=False)
    for order, (name, (_, data, _, place, message_type), time) in bar:
        kind, recorded = kinds[absolute(name)], time.to_nsec()
        found.counts[kind] = found.counts.get(kind, 0) + 1
        found.start = found.start or recorded
        try:
            if kind in ("depth", "rgb"):
                getattr(found, kind).append(_head(message_type().deserialize(data), kind, pixels, order, recorded, place))
                continue
            if kind.endswith("_info"):
                if infos.get(kind) == data[12:]:
                    continue
                infos[kind] = data[12:]  # without sequence number and stamp
            getattr(found, kind).append(Small(order, SMALL[kind]().deserialize(data)))
        except (UnicodeError, genpy.DeserializationError):
            found.unreadable.append((kind, recorded))
    return found


def _head(message, kind, pixels, *where):
    is_compressed, problem = message._type == CompressedImage._type, ""
    size = None if is_compressed else (message.width, message.height)
    try:
        if kind == "depth":
            check_depth(message)
        elif pixels:
            size = bgr(message, deep=True).shape[1::-1]
    except ImageError as error:
        problem = str(error)
    return Head(*where, message.header.stamp.to_nsec(), message.header.frame_id,
                message.format if is_compressed else message.encoding, size, problem, zlib.crc32(message.data) if pixels else 0)


def newest(messages, order):
    """The last message (Small or Head) recorded at or before `order`, else the first; None where there are none."""
    before = [message for message in messages if message.order <= order]
    return before[-1] if before else messages[0] if messages else None
