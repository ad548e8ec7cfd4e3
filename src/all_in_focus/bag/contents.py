# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A bag as input of the nodes: checks that everything is there, and reads the messages in order."""
from sensor_msgs.msg import CompressedImage
from tf2_msgs.msg import TFMessage

from all_in_focus.bag.bag_file import REQUIRED, TYPES, BagError, BagFile, Topics, absolute
from all_in_focus.bag.image_messages import ImageError, bgr, to_message

__all__ = ["TYPES", "BagContents", "BagError", "Topics"]


class BagContents:
    """An opened bag that has everything the nodes need.

    start: time of the first message; counts: messages by kind; optics: the first Optics message or None;
    depth_info, rgb_info: the first ones; static_transforms: all of /tf_static in one message.
    problems: one line for each message that messages() left out.
    """

    def __init__(self, path, topics=None):
        self.path = path
        self._file = BagFile(path, topics)
        self._topics = self._file.topics
        self.problems = []
        self._check_topics()
        self.counts = {kind: self._file.found[name].message_count for kind, name in self._topics.items()
                       if name in self._file.found}
        self.start = min(self._file.first(self._topics[kind])[1] for kind in ("depth", "rgb"))
        self.depth_info = self._file.first(self._topics["depth_info"])[0]
        self.rgb_info = self._file.first(self._topics["rgb_info"])[0]
        self.optics = self._file.first(self._topics["optics"])[0] if self.counts.get("optics") else None
        self.static_transforms = self._collect_static_transforms()
        self._check_transforms()

    def close(self):
        self._file.close()

    def messages(self):
        """Yields (kind, message, time) in recorded order; kinds are those of Topics, and "tf". Colour is decoded."""
        kinds = {name: kind for kind, name in self._topics.items()}
        kinds["/tf"] = "tf"
        for name, message, time in self._file.read(list(kinds)):
            kind = kinds[absolute(name)]
            if kind == "rgb" and message._type == CompressedImage._type:
                message = self._decoded(message, name)
            if message is not None:
                yield kind, message, time

    def _check_topics(self):
        for kind in self._file.missing():
            others = ", ".join(self._file.alternatives(kind))
            raise BagError(f"{self.path}: no {REQUIRED[kind]}: nothing on {self._topics[kind]}"
                           + (f" (there are {others})" if others else ""))
        for _, problem in self._file.wrong_types():
            raise BagError(f"{self.path}: {problem}")

    def _collect_static_transforms(self):
        """All static transforms in one message: a latched topic repeats only the last message of each publisher."""
        by_child = {}
        for _, message, _ in self._file.read(["/tf_static"]):
            by_child.update((transform.child_frame_id, transform) for transform in message.transforms)
        return TFMessage(list(by_child.values()))

    def _check_transforms(self):
        """BagError unless tf connects both cameras."""
        depth_frame = self._file.first(self._topics["depth"])[0].header.frame_id.lstrip("/")
        rgb_frame = self.rgb_info.header.frame_id.lstrip("/")
        tree = _Frames(self.static_transforms.transforms)
        if tree.connected(depth_frame, rgb_frame):
            return
        if not self._file.has_topic("/tf") and not self._file.has_topic("/tf_static"):
            raise BagError(f"{self.path}: no transform: nothing on /tf_static or /tf")
        for _, message, _ in self._file.read(["/tf"]):
            tree.add(message.transforms)
            if tree.connected(depth_frame, rgb_frame):
                return
        raise BagError(f"{self.path}: no transform connects depth frame '{depth_frame}' with colour frame "
                       f"'{rgb_frame}'")

    def _decoded(self, message, name):
        try:
            return to_message(bgr(message), "bgr8", message.header)
        except ImageError as error:
            self.problems.append(f"{name}: image of {message.header.stamp.to_sec():.6f}: {error}")
            return None


class _Frames:
    """Disjoint sets of frames, merged by transforms."""

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
