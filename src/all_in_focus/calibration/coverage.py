# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which views of the board are worth taking, and when there are enough: as ROS's camera_calibration judges it, for both
cameras at once."""
import numpy as np

NEW = 0.2  # sum of the differences in what View measures
RANGES = {"across": 0.7, "down": 0.7, "size": 0.4, "tilt": 0.5}  # to be spanned; size and tilt from 0 on
STILL = 0.003  # of the picture's width: less than that a board that is held still moves from picture to picture
ADVICE = {"across": "to the left and right border", "down": "to the upper and lower border", "size": "nearer",
          "tilt": "tilted more"}


def measure(outline, size):
    """Place across and down (0..1), size (share of the picture's side), tilt (0..1) of a board; outline: 4 x 2, pixels.

    size: (width, height) of the picture.
    """
    area = 0.5 * abs(_cross(outline[2] - outline[0], outline[3] - outline[1]))
    side = np.sqrt(area)
    middle = outline.mean(axis=0)
    place = np.clip((middle - side / 2) / np.maximum(np.array(size) - side, 1), 0, 1)
    edges = outline[[0, 2]] - outline[1]
    cosine = edges[0] @ edges[1] / np.prod(np.linalg.norm(edges, axis=1))
    tilt = min(1, 2 * abs(np.pi / 2 - np.arccos(np.clip(cosine, -1, 1))))
    return np.array([*place, np.sqrt(area / np.prod(size)), tilt])


def _cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


class Coverage:
    """Views taken so far, each measured in both cameras."""

    def __init__(self):
        self._views = []

    def __len__(self):
        return len(self._views)

    def is_new(self, view):
        """view: 2 x 4, measure() of both cameras. New is what is new to either."""
        return all(np.abs(view - other).sum(axis=1).max() > NEW for other in self._views)

    def add(self, view):
        self._views.append(np.asarray(view))

    def progress(self):
        """Share of each of RANGES that is spanned, in the camera that has seen more of it: the other's picture may be
        wider than what both see."""
        if not self._views:
            return dict.fromkeys(RANGES, 0.0)
        views = np.array(self._views)
        low = views.min(axis=0) * [1, 1, 0, 0]
        spanned = (views.max(axis=0) - low).max(axis=0)
        return {name: float(min(1, span / wanted)) for (name, wanted), span in zip(RANGES.items(), spanned)}

    def lacking(self):
        """What to do with the board, as words; empty when there is enough of everything."""
        return [ADVICE[name] for name, share in self.progress().items() if share < 1]


def moved(board, corners, before):
    """How far the board has moved since, in pixels (mean); the order of the corners may have changed."""
    return min(float(np.linalg.norm(order - before, axis=1).mean()) for order in board.orders(corners))
