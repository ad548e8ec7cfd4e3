# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The outputs of the nodes, collected bracket by bracket and saved.

On disk: bracket_0000/{fused,labels,regions,registered,source_index,confidence,weights}.png and report.json; in mode
restored depth_restored.png too.
"""
import functools
import json
import math
import os
import re
import shutil
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
# file name: topic, encoding to save (OpenCV writes BGR)
IMAGES = {"fused": ("all_in_focus/image", "passthrough"), "registered": ("all_in_focus/depth", "passthrough"),
          "depth_restored": ("all_in_focus/depth_restored", "passthrough"),
          "source_index": ("all_in_focus/source_index", "passthrough"),
          "confidence": ("all_in_focus/confidence", "passthrough"), "weights": ("all_in_focus/weights_color", "bgr8"),
          "labels": ("segmentation/labels", "passthrough"), "regions": ("segmentation/image_color", "bgr8")}
SEGMENTS, REPORT = "segmentation/segments", "all_in_focus/report"
OF_LABELS = ("labels", "regions", "segments")  # with the stamp of a label image, which brackets may share
NODES = ("depth_preprocess", "segmenter", "fusion")
MAX_COMPLAINTS = 20


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


def report_dict(report, segments=None):
    """FusionReport under its own field names; segments: plain SegmentArray of its label image, for the table of the regions."""
    plain = {"version": REPORT_VERSION}
    plain.update(to_plain(report))
    del plain["header"]["seq"]  # a counter of the publisher
    if not report.has_labels:
        plain["label_stamp"] = None
    if segments is not None:
        plain.update(dof_rule=segments["dof_rule"], unknown_area=segments["unknown_area"], segment_table=segments["segments"])
    return plain


def encode_labels(labels):
    """16-bit PNG, as bytes, of an image of labels >= 0. ValueError above 65535 regions."""
    greatest = int(labels.max()) if labels.size else 0
    if greatest > MAX_LABEL:
        raise ValueError(f"{greatest} regions do not fit a 16-bit PNG ({MAX_LABEL} at most): smooth the depth or use "
                         "wider optics")
    return encode_png(labels.astype(np.uint16))


class ResultFolder(OutputFolder):
    """The brackets of one run. commit() puts them in the place of an earlier run's; discard() must follow. Needs no ROS master.

    Brackets that evaluate_bag did not write are an OSError; other things of the user in the folder stay there.
    All outputs of a result have the stamp of its report; those OF_LABELS that of report.label_stamp. Outputs may come before the
    report or after: until commit() each is a file by name and stamp. Brackets are numbered in the order of their reports.
    """

    def __init__(self, path):
        super().__init__(path, "evaluate_bag", lambda name: not re.fullmatch(r"bracket_\d{4,}", name), parents=True)
        self.reports = []

    @staticmethod
    def name(number):
        """Folder of a bracket; brackets are counted from 0 in the order of their reports."""
        return f"bracket_{number:04d}"

    def add(self, name, stamp, data):
        """data: PNG, or the SegmentArray as JSON; bytes."""
        with named(self.path, self.working):
            self._part(name, stamp).write_bytes(data)

    def missing(self):
        """Topics of what has not come, by the number of its report."""
        missing = {number: [name for name, part in self._wanted(report).items() if not part.exists()]
                   for number, report in enumerate(self.reports)}
        return {number: [IMAGES.get(name, (SEGMENTS,))[0] for name in names] for number, names in missing.items() if names}

    def commit(self):
        """When nothing is missing."""
        with named(self.path, self.working):
            for number, report in enumerate(self.reports):
                wanted, folder = self._wanted(report), self.working / self.name(number)
                folder.mkdir()
                segments = json.loads(wanted.pop("segments").read_text(encoding="utf-8")) if "segments" in wanted else None
                write_json(folder / "report.json", report_dict(report, segments))
                for name, part in wanted.items():
                    (shutil.copyfile if name in OF_LABELS else os.replace)(part, folder / f"{name}.png")
            for part in self.working.glob("part_*"):
                part.unlink()
        super().commit()

    def _part(self, name, stamp):
        return self.working / f"part_{name}_{stamp.to_nsec()}"

    def _wanted(self, report):
        """The file of each part of a bracket, by name. Without focus distances a restored one has no depth."""
        if report.frames_used == 0:
            return {}
        names = ["fused", "source_index", "confidence", "weights"]
        restored = self._part("depth_restored", report.header.stamp)
        if report.mode == "restored" and (report.blur_scale > 0 or restored.exists()):
            names.append("depth_restored")
        if not report.sharpness_alone:
            names.append("registered")
        if report.has_labels:
            names.extend(OF_LABELS)
        return {name: self._part(name, report.label_stamp if name in OF_LABELS else report.header.stamp) for name in names}


class ResultSaver:
    """Gives what the nodes publish to a ResultFolder."""

    def __init__(self, folder):
        self._lock = threading.Lock()
        self._folder = folder
        self._error = None  # the first error, one line
        self.subscribers = {topic: rospy.Subscriber(topic, Image, functools.partial(self._keep, name, encoding))
                            for name, (topic, encoding) in IMAGES.items()}
        self.subscribers[SEGMENTS] = rospy.Subscriber(SEGMENTS, SegmentArray, functools.partial(self._keep, "segments", None))
        self.subscribers[REPORT] = rospy.Subscriber(REPORT, FusionReport, folder.reports.append)
        self._complaints = {}  # text of a node: level
        self._log = rospy.Subscriber("/rosout", Log, self._on_log)

    def check(self):
        """ValueError where something could not be saved."""
        if self._error:
            raise ValueError(self._error)

    def has_saved(self, brackets):
        """Whether so many brackets have come, with all of their images."""
        with self._lock:
            return len(self._folder.reports) >= brackets and not self._folder.missing()

    def finish(self):
        """What is missing, as evaluation.conclude() takes it; from then on nothing is added. ValueError."""
        for subscriber in self.subscribers.values():
            subscriber.unregister()
        with self._lock:
            self.check()
            return self._folder.missing()

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

    def _keep(self, name, encoding, message):
        try:
            if name == "segments":
                data = json.dumps(to_plain(message)).encode()
            else:
                image = BRIDGE.imgmsg_to_cv2(message, encoding)
                data = encode_labels(image) if name == "labels" else encode_png(image)
            with self._lock:
                self._folder.add(name, message.header.stamp, data)
        except (cv_bridge.CvBridgeError, ValueError, OSError) as error:
            self._error = self._error or f"{name}: {one_line(error)}"
