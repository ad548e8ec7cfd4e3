# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Collects the outputs of the fusion and saves them bracket by bracket."""
import functools
import re
import threading
from collections import OrderedDict

import cv_bridge
import rospy
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import Image

from all_in_focus.msg import FusionReport, SegmentArray
from all_in_focus.files.result_files import ResultError, encode_labels, encode_png, report_dict

# file name: topic, encoding to save (images are saved as OpenCV has them: BGR)
IMAGES = {"fused": ("all_in_focus/image", "bgr8"), "registered": ("all_in_focus/depth", "passthrough"),
          "source_index": ("all_in_focus/source_index", "passthrough"),
          "confidence": ("all_in_focus/confidence", "passthrough"), "weights": ("all_in_focus/weights_color", "bgr8")}
LABELS, SEGMENTS, REPORT = "segmentation/labels", "segmentation/segments", "all_in_focus/report"
NODES = ("depth_preprocess", "segmenter", "fusion")
MAX_COMPLAINTS = 20
KEPT = 2000  # label images, compressed, that no report has asked for yet


class BracketCollector:
    """Puts together what belongs together. Not thread-safe; without ROS.

    All outputs of a result have the stamp of its report; labels and segments that of report.label_stamp. Outputs may
    come before the report or after. Brackets are numbered in the order of their reports.
    """

    def __init__(self, folder):
        self._folder = folder
        self._parts = {name: OrderedDict() for name in [*IMAGES, "labels", "segments"]}  # data by stamp in ns
        self._pending = OrderedDict()  # reports by number
        self.brackets = []  # dicts, see run_status.conclude()

    def add(self, name, stamp, data):
        """data: PNG as bytes, a SegmentArray, or a ResultError to raise if a bracket wants this part."""
        parts = self._parts[name]
        parts[stamp.to_nsec()] = data
        while len(parts) > KEPT:
            parts.popitem(last=False)
        self._save_complete()

    def add_report(self, report):
        number = len(self.brackets)
        self.brackets.append({"folder": self._folder.name(number), "bracket_id": report.bracket_id,
                              "frames_used": report.frames_used,
                              "regions": sum(choice.label > 0 for choice in report.segments), "missing": [], "notes": list(report.notes)})
        self._pending[number] = report
        self._save_complete()

    @property
    def waiting(self):
        """Whether a report waits for its images."""
        return bool(self._pending)

    def finish(self):
        """Nothing more will come: write down what is missing."""
        for number, report in self._pending.items():
            self.brackets[number]["missing"] = self._missing(report)

    @staticmethod
    def _wanted(report):
        """Stamps in ns of all parts of a bracket by name."""
        if report.frames_used == 0:
            return {}
        result, label = report.header.stamp.to_nsec(), report.label_stamp.to_nsec()
        wanted = dict.fromkeys(("fused", "source_index", "confidence", "weights"), result)
        if report.has_labels:
            wanted.update(registered=result, labels=label, segments=label)
        return wanted

    def _missing(self, report):
        return [IMAGES[name][0] if name in IMAGES else "segmentation/" + name
                for name, stamp in self._wanted(report).items() if stamp not in self._parts[name]]

    def _save_complete(self):
        for number in [n for n, report in self._pending.items() if not self._missing(report)]:
            report = self._pending.pop(number)
            wanted = self._wanted(report)
            files = {name: self._parts[name][stamp] for name, stamp in wanted.items()}
            segments = files.pop("segments", None)
            for data in files.values():
                if isinstance(data, ResultError):
                    raise data
            self._folder.save(number, files, report_dict(report, segments))
            self._forget(wanted)

    def _forget(self, wanted):
        """Later brackets use the same label image or later ones."""
        for name, stamp in wanted.items():
            parts = self._parts[name]
            for key in [key for key in parts if key < stamp or key == stamp and name in IMAGES]:
                del parts[key]


class ResultSaver:
    """Subscribes the outputs and feeds a BracketCollector."""

    def __init__(self, folder):
        self._lock = threading.Lock()
        self._collector = BracketCollector(folder)
        self._bridge = cv_bridge.CvBridge()
        self.error = None  # the first one, one line
        self.subscribers = {topic: rospy.Subscriber(topic, Image, functools.partial(self._on_image, name, encoding))
                            for name, (topic, encoding) in {**IMAGES, "labels": (LABELS, "passthrough")}.items()}
        self.subscribers[SEGMENTS] = rospy.Subscriber(SEGMENTS, SegmentArray, self._on_segments)
        self.subscribers[REPORT] = rospy.Subscriber(REPORT, FusionReport, self._on_report)
        self._complaints = {}  # text of a node: level
        self._log = rospy.Subscriber("/rosout", Log, self._on_log)

    def progress(self):
        """(reports so far, whether one of them waits for its images)."""
        with self._lock:
            return len(self._collector.brackets), self._collector.waiting

    def finish(self):
        """What became of every bracket, see run_status.conclude()."""
        for subscriber in self.subscribers.values():
            subscriber.unregister()
        with self._lock:
            self._collector.finish()
            return self._collector.brackets

    def complaints(self):
        """Errors and warnings that the nodes have logged, one line each, errors first."""
        with self._lock:
            return [text for text, _ in sorted(self._complaints.items(), key=lambda item: -item[1])]

    def _on_log(self, message):
        # Nodelets log "/name: text" under their manager's name.
        nodelet = re.match(r"\S*/(%s): " % "|".join(NODES), message.msg)
        if message.level >= Log.WARN and nodelet and len(self._complaints) < MAX_COMPLAINTS:
            with self._lock:
                self._complaints.setdefault(" ".join(message.msg[message.msg.index(nodelet[1]):].split()), message.level)

    def _on_image(self, name, encoding, message):
        try:
            image = self._bridge.imgmsg_to_cv2(message, encoding)
            data = encode_labels(image) if name == "labels" else encode_png(image)
        except ResultError as error:
            data = error
        except cv_bridge.CvBridgeError as error:
            data = ResultError("%s: %s" % (name, " ".join(str(error).split())))
        self._collect(self._collector.add, name, message.header.stamp, data)

    def _on_segments(self, message):
        self._collect(self._collector.add, "segments", message.header.stamp, message)

    def _on_report(self, message):
        self._collect(self._collector.add_report, message)

    def _collect(self, method, *arguments):
        with self._lock:
            try:
                method(*arguments)
            except ResultError as error:
                self.error = self.error or str(error)
            except OSError as error:
                self.error = self.error or "%s: %s" % (error.filename, error.strerror)
