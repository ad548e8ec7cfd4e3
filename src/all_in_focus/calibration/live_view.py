# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From pairs of pictures as they come to the pairs that a calibration needs, and the picture that guides to them."""
import os

import numpy as np

from all_in_focus.calibration import CalibrationError
from all_in_focus.calibration.board import find_corners
from all_in_focus.calibration.coverage import STILL, Coverage, measure, moved
from all_in_focus.calibration.coverage_picture import draw
from all_in_focus.calibration.pairs import CAMERAS, Pair
from all_in_focus.calibration.rig_folder import refuse_read_only
from all_in_focus.files.output_file import write_picture


class LiveView:
    """wanted: pairs to take at least; pictures: folder that keeps those taken, or None."""

    def __init__(self, board, wanted, pictures=None):
        self._board, self._wanted, self._pictures = board, wanted, pictures
        self._coverage = Coverage()
        self._before = (None, None)  # corners in the last two pictures
        self._now = None  # (images, outlines, what was said) of the last two
        self._outlines = ([], [])
        self.pairs, self.sizes = [], None
        if pictures:
            for camera in CAMERAS:
                folder = os.path.join(pictures, camera)
                os.makedirs(folder, exist_ok=True)
                refuse_read_only(folder)
                if os.listdir(folder):
                    raise CalibrationError("%s: holds pictures already: name another folder" % pictures)

    @property
    def enough(self):
        return len(self.pairs) >= self._wanted and not self._coverage.lacking()

    def add(self, images):
        """Look at the two pictures of one moment; whether the pair is taken. OSError where it is, but cannot be kept as
        pictures."""
        sizes = tuple(image.shape[1::-1] for image in images)
        self.sizes = self.sizes or sizes
        corners = [find_corners(image, self._board, thorough=False) for image in images]
        outlines = [None if found is None else self._board.outline(found) for found in corners]
        said = self._reason_against(sizes, corners, outlines)
        self._before = corners
        self._now = (images, outlines, said or "taken")
        if not said:
            self._take(images, corners, outlines)
        return not said

    def _reason_against(self, sizes, corners, outlines):
        if sizes != self.sizes:
            return "left out: the size of the pictures has changed"
        missing = [camera for camera, found in zip(CAMERAS, corners) if found is None]
        if missing:
            return "no board of %s in the %s picture" % (self._board, " and the ".join(missing))
        for found, before, size in zip(corners, self._before, sizes):
            if before is None or moved(self._board, found, before) > STILL * size[0]:
                return "hold it still"
        if not self._coverage.is_new(self._measured(outlines)):
            return "like one that is taken: move or tilt it"
        return ""

    def _measured(self, outlines):
        return np.array([measure(outline, size) for outline, size in zip(outlines, self.sizes)])

    def _take(self, images, corners, outlines):
        name = "%03d" % len(self.pairs)
        self._coverage.add(self._measured(outlines))
        self.pairs.append(Pair(name, *corners))
        for outline, taken in zip(outlines, self._outlines):
            taken.append(outline)
        if self._pictures:
            for camera, image in zip(CAMERAS, images):
                write_picture(os.path.join(self._pictures, camera, name + ".png"), image)

    def status(self):
        """Two lines: how far it is, what to do."""
        shares = ", ".join("%s %.0f %%" % (name, 100 * share) for name, share in self._coverage.progress().items())
        lacking = self._coverage.lacking()
        todo = "show it " + ", ".join(lacking) if lacking else "any new view"
        return ["%d of %d pairs; %s" % (len(self.pairs), self._wanted, shares),
                "%s; then: %s" % (self._now[2] if self._now else "no picture yet", todo)]

    def picture(self):
        """BGR; call after add()."""
        images, outlines, _ = self._now
        return draw(images, self._outlines, outlines, self.status())
