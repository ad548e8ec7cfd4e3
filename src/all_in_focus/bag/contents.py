# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A bag as input of the nodes: checks that everything is there, and reads the messages in order."""
from itertools import chain

from sensor_msgs.msg import CompressedImage
from tf2_msgs.msg import TFMessage

from all_in_focus.bag.bag_file import REQUIRED, BagError, BagFile, absolute
from all_in_focus.bag.image_messages import ImageError, bgr, to_message


class BagContents(BagFile):
    """An opened bag that has everything the nodes need.

    start: time of the first message; counts: messages by kind; optics: the first Optics message or None;
    depth_info, rgb_info: the first ones; static_transforms: all of /tf_static in one message.
    problems: one line for each message that messages() left out.
    """

    def __init__(self, path, topics=None):
        super().__init__(path, topics)
        self.problems = []
        self._check_topics()
        self.counts = {kind: self.found[name].message_count for kind, name in self.topics.items() if name in self.found}
        self.start = min(self.first(self.topics[kind])[1] for kind in ("depth", "rgb"))
        self.depth_info = self.first(self.topics["depth_info"])[0]
        self.rgb_info = self.first(self.topics["rgb_info"])[0]
        self.optics = self.first(self.topics["optics"])[0] if self.counts.get("optics") else None
        self.static_transforms = self._collect_static_transforms()
        self._check_transforms()

    def messages(self):
        """Yields (kind, message, time) in recorded order; kinds are those of Topics, and "tf". Colour is decoded."""
        kinds = {name: kind for kind, name in self.topics.items()}
        kinds["/tf"] = "tf"
        for name, message, time in self.read(list(kinds)):
            kind = kinds[absolute(name)]
            if kind == "rgb" and message._type == CompressedImage._type:
                message = self._decoded(message, name)
            if message is not None:
                yield kind, message, time

    def _check_topics(self):
        for kind in self.missing():
            others = ", ".join(self.alternatives(kind))
            raise BagError(f"{self.path}: no {REQUIRED[kind]}: nothing on {self.topics[kind]}"
                           + (f" (there are {others})" if others else ""))
        for _, problem in self.wrong_types():
            raise BagError(f"{self.path}: {problem}")

    def _collect_static_transforms(self):
        """All static transforms in one message: a latched topic repeats only the last message of each publisher."""
        by_child = {}
        for _, message, _ in self.read(["/tf_static"]):
            by_child.update((transform.child_frame_id, transform) for transform in message.transforms)
        return TFMessage(list(by_child.values()))

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

    def _decoded(self, message, name):
        try:
            return to_message(bgr(message), "bgr8", message.header)
        except ImageError as error:
            self.problems.append(f"{name}: image of {message.header.stamp.to_sec():.6f}: {error}")
            return None
