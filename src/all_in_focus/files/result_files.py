# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Results of a run on disk: bracket_0000/{fused,labels,registered,source_index,confidence,weights}.png, report.json."""
import json
import math
import os
import re
import shutil

import cv2
import genpy
import numpy as np

REPORT_VERSION = 1
NO_FRAME = 65535  # source_index of a pixel that no frame has won
MAX_LABEL = 65535
STAGING = ".incomplete"


class ResultError(ValueError):
    """A result that cannot be written; the message is one line."""


def to_plain(value):
    """ROS message, or a field of one, as JSON knows it: times in seconds, NaN and infinity as null."""
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
    del plain["header"]["seq"]  # counts what the node published, says nothing of the result
    if not report.has_labels:
        plain["label_stamp"] = None
    if segment_array is not None:
        plain["dof_rule"] = segment_array.dof_rule
        plain["unknown_area"] = segment_array.unknown_area
        plain["segment_table"] = to_plain(segment_array.segments)
    return plain


def encode_png(image):
    """PNG file as bytes; colour images are BGR."""
    good, data = cv2.imencode(".png", image)
    if not good:
        raise ResultError("an image of type %s cannot be written as PNG" % image.dtype)
    return data.tobytes()


def encode_labels(labels):
    """16-bit PNG, as bytes, of an image of labels >= 0. Raises ResultError above 65535 regions."""
    greatest = int(labels.max()) if labels.size else 0
    if greatest > MAX_LABEL:
        raise ResultError("%d regions do not fit a 16-bit PNG (%d at most): smooth the depth or use wider optics"
                          % (greatest, MAX_LABEL))
    return encode_png(labels.astype(np.uint16))


class ResultFolder:
    """Brackets of one run. They take the place of an earlier run's only in commit(), all of them."""

    def __init__(self, path):
        self.path = os.path.abspath(path)
        self._is_new = not os.path.isdir(self.path)
        self._staging = os.path.join(self.path, STAGING)
        os.makedirs(self.path, exist_ok=True)
        shutil.rmtree(self._staging, ignore_errors=True)  # of a run that was killed
        os.mkdir(self._staging)

    @staticmethod
    def name(number):
        """Folder of a bracket: they are counted from 0 in the order of their reports."""
        return "bracket_%04d" % number

    def save(self, number, files, report):
        """Write one bracket. files: PNG bytes by name, without ending; report: plain dictionary."""
        folder = os.path.join(self._staging, self.name(number))
        working = folder + ".partial"
        os.mkdir(working)
        for name, data in files.items():
            with open(os.path.join(working, name + ".png"), "wb") as file:
                file.write(data)
        with open(os.path.join(working, "report.json"), "w", encoding="utf-8") as file:
            json.dump(report, file, indent=2, allow_nan=False)
            file.write("\n")
        os.rename(working, folder)

    def commit(self):
        """The new brackets replace the old ones; older brackets beyond their number go."""
        new = sorted(name for name in os.listdir(self._staging) if not name.endswith(".partial"))
        for name in new:
            target, old = os.path.join(self.path, name), os.path.join(self._staging, name + ".old.partial")
            if os.path.lexists(target):
                os.rename(target, old)
            os.rename(os.path.join(self._staging, name), target)
        for name in os.listdir(self.path):
            if re.fullmatch(r"bracket_\d{4,}", name) and name not in new:
                shutil.rmtree(os.path.join(self.path, name))
        shutil.rmtree(self._staging)

    def discard(self):
        """Forget the new brackets; an earlier run's stay."""
        shutil.rmtree(self._staging, ignore_errors=True)
        if self._is_new and os.path.isdir(self.path) and not os.listdir(self.path):
            os.rmdir(self.path)
