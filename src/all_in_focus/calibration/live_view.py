# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Chooses the pairs of pictures that a live calibration takes, and draws the picture that guides the user.

A view is worth taking when it differs from those taken before, as ROS's camera_calibration judges it, in either camera.
"""
from pathlib import Path

import cv2
import numpy as np

from all_in_focus.calibration.board import CAMERAS, Pair, find_corners, gray
from all_in_focus.files.output_file import write_picture
from all_in_focus.files.output_folder import require_writable
from all_in_focus.imaging import with_lines

HEIGHT = 360  # pixels, of both pictures
TAKEN, SEEN = (60, 200, 60), (60, 180, 255)  # BGR
NEW = 0.2  # a new view differs by so much, summed over what measure() returns
RANGES = {"across": 0.7, "down": 0.7, "size": 0.4, "tilt": 0.5}  # that the views must span; size and tilt from 0 on
STILL = 0.003  # of the picture's width: a board that is held still moves less from picture to picture
ADVICE = {"across": "to the left and right border", "down": "to the upper and lower border", "size": "nearer",
          "tilt": "tilted more"}


def measure(outline, size):
    """Place across and down (0..1), size (share of the picture's side), tilt (0..1) of a board; outline: 4 x 2, pixels.

    size: (width, height) of the picture.
    """
    area = cv2.contourArea(outline.astype(np.float32))
    side = np.sqrt(area)
    middle = outline.mean(axis=0)
    place = np.clip((middle - side / 2) / np.maximum(np.array(size) - side, 1), 0, 1)
    edges = outline[[0, 2]] - outline[1]
    cosine = edges[0] @ edges[1] / np.prod(np.linalg.norm(edges, axis=1))
    tilt = min(1, 2 * abs(np.pi / 2 - np.arccos(np.clip(cosine, -1, 1))))
    return np.array([*place, np.sqrt(area / np.prod(size)), tilt])


class Coverage:
    def __init__(self):
        self._views = []

    def is_new(self, view):
        """Whether a view is new to either camera; view: 2 x 4, measure() of both."""
        return all(np.abs(view - other).sum(axis=1).max() > NEW for other in self._views)

    def add(self, view):
        self._views.append(np.asarray(view))

    def progress(self):
        """Share of each of RANGES that is spanned, in the camera that has seen more of it: the other camera may have a
        field of view so wide that the board cannot reach its borders in both."""
        if not self._views:
            return dict.fromkeys(RANGES, 0.0)
        views = np.array(self._views)
        low = views.min(axis=0) * [1, 1, 0, 0]
        spanned = (views.max(axis=0) - low).max(axis=0)
        return {name: float(min(1, span / wanted)) for (name, wanted), span in zip(RANGES.items(), spanned)}

    def lacking(self):
        """What to do with the board, in words; empty when the views span all RANGES."""
        return [ADVICE[name] for name, share in self.progress().items() if share < 1]


def moved(board, corners, before):
    """Mean distance in pixels that the board has moved; the order of the corners may have changed."""
    return min(float(np.linalg.norm(order - before, axis=1).mean()) for order in board.orders(corners))


def _pane(image, taken, seen):
    """BGR picture of one camera's image; taken: outlines, 4 x 2 pixels; seen: one more, or None."""
    scale = HEIGHT / image.shape[0]
    width = max(1, round(image.shape[1] * scale))
    small = cv2.resize(np.rint(gray(image)).astype(np.uint8), (width, HEIGHT), interpolation=cv2.INTER_AREA)
    pane = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
    shapes = [np.rint(outline * scale).astype(np.int32) for outline in taken]
    covered = pane.copy()
    for shape in shapes:
        cv2.fillConvexPoly(covered, shape, TAKEN)
    pane = cv2.addWeighted(covered, 0.3, pane, 0.7, 0)
    cv2.polylines(pane, shapes, True, TAKEN, 1, cv2.LINE_AA)
    if seen is not None:
        cv2.polylines(pane, [np.rint(seen * scale).astype(np.int32)], True, SEEN, 3, cv2.LINE_AA)
    return pane


class LiveView:
    """The pairs of a live calibration. wanted: least number of pairs; pictures: folder that keeps them, or None."""

    def __init__(self, board, wanted, pictures=None):
        self._board, self._wanted, self._pictures = board, wanted, pictures
        self._coverage = Coverage()
        self._before = (None, None)  # corners in the last two pictures
        self._now = None  # (images, outlines, what was said) of the last two
        self._outlines = ([], [])
        self.pairs, self.sizes = [], None
        if pictures:
            for camera in CAMERAS:
                folder = Path(pictures) / camera
                folder.mkdir(parents=True, exist_ok=True)
                if any(folder.iterdir()):
                    raise ValueError(f"{pictures}: holds pictures already: name another folder")
                require_writable(folder)

    @property
    def enough(self):
        return len(self.pairs) >= self._wanted and not self._coverage.lacking()

    def add(self, images):
        """Looks at the two pictures of one moment; returns whether the pair is taken. OSError where it is taken, but
        its pictures cannot be saved."""
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
            return f"no board of {self._board} in the {' and the '.join(missing)} picture"
        for found, before, size in zip(corners, self._before, sizes):
            if before is None or moved(self._board, found, before) > STILL * size[0]:
                return "hold it still"
        if not self._coverage.is_new(self._measured(outlines)):
            return "like one that is taken: move or tilt it"
        return ""

    def _measured(self, outlines):
        return np.array([measure(outline, size) for outline, size in zip(outlines, self.sizes)])

    def _take(self, images, corners, outlines):
        name = f"{len(self.pairs):03}"
        self._coverage.add(self._measured(outlines))
        self.pairs.append(Pair(name, *corners))
        for outline, taken in zip(outlines, self._outlines):
            taken.append(outline)
        if self._pictures:
            for camera, image in zip(CAMERAS, images):
                write_picture(Path(self._pictures) / camera / f"{name}.png", image)

    def status(self):
        """Two lines: the progress, and what to do next."""
        shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in self._coverage.progress().items())
        lacking = self._coverage.lacking()
        todo = f"show it {', '.join(lacking)}" if lacking else "any new view"
        return [f"{len(self.pairs)} of {self._wanted} pairs; {shares}",
                f"{self._now[2] if self._now else 'no picture yet'}; then: {todo}"]

    def picture(self):
        """BGR: both cameras' images side by side, boards of the views taken in green, the board seen now in orange; call
        after add()."""
        images, outlines, _ = self._now
        one, other = (_pane(*camera) for camera in zip(images, self._outlines, outlines))
        return with_lines(np.hstack([one, np.zeros((HEIGHT, 4, 3), np.uint8), other]), self.status())
