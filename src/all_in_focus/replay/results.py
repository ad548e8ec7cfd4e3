# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The outputs of the nodes, collected bracket by bracket and saved.

On disk: bracket_0000/{fused,labels,regions,registered,source_index,confidence,weights}.png and report.json; in mode
restored depth_restored.png too.
"""
import functools
import math
import re
import threading

import cv_bridge
import genpy
import numpy as np
import rospy
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import Image

from all_in_focus.files.errors import one_line
from all_in_focus.files.output_file import encode_png, named, write_json
from all_in_focus.files.output_folder import OutputFolder
from all_in_focus.image_messages import BRIDGE
from all_in_focus.msg import FusionReport, SegmentArray

REPORT_VERSION = 1
MAX_LABEL = 65535
DEPTH_RESTORED = "all_in_focus/depth_restored"
# file name: topic, encoding to save (OpenCV writes BGR)
IMAGES = {"fused": ("all_in_focus/image", "passthrough"), "registered": ("all_in_focus/depth", "passthrough"),
          "depth_restored": (DEPTH_RESTORED, "passthrough"),
          "source_index": ("all_in_focus/source_index", "passthrough"),
          "confidence": ("all_in_focus/confidence", "passthrough"), "weights": ("all_in_focus/weights_color", "bgr8")}
OF_LABELS = {"labels": ("segmentation/labels", "passthrough"), "regions": ("segmentation/image_color", "bgr8")}
SEGMENTS, REPORT = "segmentation/segments", "all_in_focus/report"
NODES = ("depth_preprocess", "segmenter", "fusion")
MAX_COMPLAINTS = 20
KEPT = 2000  # label images (compressed) to keep until a report asks for them


def to_plain(value):
    """A ROS message, or a field of one, for JSON: times in seconds, NaN and infinity as null."""
    if isinstance(value, genpy.Message):
        return {name: to_plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, genpy.rostime.TVal):
        return value.to_sec()
    if isinstance(value, (list, tuple)):
        return [to_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def report_dict(report, segment_array=None):
    """FusionReport under its own field names; with the SegmentArray of its label image, the table of the regions."""
    plain = {"version": REPORT_VERSION}
    plain.update(to_plain(report))
    del plain["header"]["seq"]  # a counter of the publisher
    if not report.has_labels:
        plain["label_stamp"] = None
    if segment_array is not None:
        plain["dof_rule"] = segment_array.dof_rule
        plain["unknown_area"] = segment_array.unknown_area
        plain["segment_table"] = to_plain(segment_array.segments)
    return plain


def encode_labels(labels):
    """16-bit PNG, as bytes, of an image of labels >= 0. ValueError above 65535 regions."""
    greatest = int(labels.max()) if labels.size else 0
    if greatest > MAX_LABEL:
        raise ValueError(f"{greatest} regions do not fit a 16-bit PNG ({MAX_LABEL} at most): smooth the depth or use "
                         "wider optics")
    return encode_png(labels.astype(np.uint16))


class ResultFolder(OutputFolder):
    """The brackets of one run. commit() puts them in the place of an earlier run's; discard() must follow.

    Brackets that evaluate_bag did not write are an OSError; other things of the user in the folder stay there.
    """

    def __init__(self, path):
        super().__init__(path, "evaluate_bag", lambda name: not re.fullmatch(r"bracket_\d{4,}", name), parents=True)

    @staticmethod
    def name(number):
        """Folder of a bracket; brackets are counted from 0 in the order of their reports."""
        return f"bracket_{number:04d}"

    def save(self, number, files, report):
        """Writes one bracket. files: PNG bytes by name, without suffix; report: plain dictionary."""
        folder = self.working / self.name(number)
        with named(self.path, self.working):
            folder.mkdir()
            for name, data in files.items():
                (folder / f"{name}.png").write_bytes(data)
            write_json(folder / "report.json", report)


class BracketCollector:
    """Assembles the outputs of each bracket. Not thread-safe; needs no ROS master.

    All outputs of a result have the stamp of its report; labels and segments that of report.label_stamp. Outputs may
    come before the report or after. Brackets are numbered in the order of their reports.
    """

    def __init__(self, folder):
        self._folder = folder
        self._parts = {name: {} for name in [*IMAGES, *OF_LABELS, "segments"]}  # data by stamp in ns
        self._pending = {}  # reports by number
        self.reports = []

    def add(self, name, stamp, data):
        """data: PNG as bytes, or a SegmentArray."""
        parts = self._parts[name]
        parts[stamp.to_nsec()] = data
        while len(parts) > KEPT:
            del parts[next(iter(parts))]
        self._save_complete()

    def add_report(self, report):
        self._pending[len(self.reports)] = report
        self.reports.append(report)
        self._save_complete()

    def missing(self):
        """Topics of what has not come, by the number of its report."""
        return {number: self._missing(report) for number, report in self._pending.items()}

    def _wanted(self, report):
        """Stamp (ns) of each part of a bracket, by name. Without focus distances a restored one has no depth."""
        if report.frames_used == 0:
            return {}
        result, label = report.header.stamp.to_nsec(), report.label_stamp.to_nsec()
        wanted = dict.fromkeys(("fused", "source_index", "confidence", "weights"), result)
        if report.mode == "restored" and (report.blur_scale > 0 or result in self._parts["depth_restored"]):
            wanted["depth_restored"] = result
        if not report.sharpness_alone:
            wanted["registered"] = result
        if report.has_labels:
            wanted.update(labels=label, regions=label, segments=label)
        return wanted

    def _missing(self, report):
        topics = {name: topic for name, (topic, _) in {**IMAGES, **OF_LABELS, "segments": (SEGMENTS, "")}.items()}
        return [topics[name] for name, stamp in self._wanted(report).items() if stamp not in self._parts[name]]

    def _save_complete(self):
        for number in [n for n, report in self._pending.items() if not self._missing(report)]:
            report = self._pending.pop(number)
            wanted = self._wanted(report)
            files = {name: self._parts[name][stamp] for name, stamp in wanted.items()}
            segments = files.pop("segments", None)
            self._folder.save(number, files, report_dict(report, segments))
            for name, stamp in wanted.items():  # later brackets have the same label image or later ones
                self._parts[name] = {key: data for key, data in self._parts[name].items()
                                     if key > stamp or key == stamp and name not in IMAGES}


class ResultSaver:
    def __init__(self, folder):
        self._lock = threading.Lock()
        self._collector = BracketCollector(folder)
        self._error = None  # the first error, one line
        self.subscribers = {topic: rospy.Subscriber(topic, Image, functools.partial(self._on_image, name, encoding))
                            for name, (topic, encoding) in {**IMAGES, **OF_LABELS}.items()}
        self.subscribers[SEGMENTS] = rospy.Subscriber(SEGMENTS, SegmentArray, lambda message: self._collect(
            self._collector.add, "segments", message.header.stamp, message))
        self.subscribers[REPORT] = rospy.Subscriber(REPORT, FusionReport,
                                                    functools.partial(self._collect, self._collector.add_report))
        self._complaints = {}  # text of a node: level
        self._log = rospy.Subscriber("/rosout", Log, self._on_log)

    def check(self):
        """ValueError where something could not be saved."""
        if self._error:
            raise ValueError(self._error)

    def has_saved(self, brackets):
        """Whether so many brackets have come, with all of their images."""
        with self._lock:
            return len(self._collector.reports) >= brackets and not self._collector.missing()

    def finish(self):
        """The reports, and what is missing, as graph.conclude() takes them. ValueError."""
        self.check()
        for subscriber in self.subscribers.values():
            subscriber.unregister()
        with self._lock:
            return self._collector.reports, self._collector.missing()

    def complaints(self):
        """Errors and warnings that the nodes have logged, one line each, errors first."""
        with self._lock:
            return [text for text, _ in sorted(self._complaints.items(), key=lambda item: -item[1])]

    def _on_log(self, message):
        # Nodelets log "/name: text" under their manager's name.
        nodelet = re.match(rf"\S*/({'|'.join(NODES)}): ", message.msg)
        if message.level >= Log.WARN and nodelet and len(self._complaints) < MAX_COMPLAINTS:
            with self._lock:
                text = " ".join(message.msg[message.msg.index(nodelet[1]):].split())
                self._complaints.setdefault(text, message.level)

    def _on_image(self, name, encoding, message):
        try:
            image = BRIDGE.imgmsg_to_cv2(message, encoding)
            data = encode_labels(image) if name == "labels" else encode_png(image)
        except (cv_bridge.CvBridgeError, ValueError) as error:
            self._error = self._error or f"{name}: {one_line(error)}"
            return
        self._collect(self._collector.add, name, message.header.stamp, data)

    def _collect(self, method, *arguments):
        with self._lock:
            try:
                method(*arguments)
            except OSError as error:
                self._error = self._error or one_line(error)
