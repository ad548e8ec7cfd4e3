# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The picture that a person with the board in hands looks at."""
import cv2
import numpy as np

from all_in_focus.calibration.board import gray

HEIGHT, LINE = 360, 26  # pixels: of both pictures, of a line of text
TAKEN, SEEN, INK = (60, 200, 60), (60, 180, 255), (230, 230, 230)  # BGR


def draw(images, taken, seen, lines):
    """BGR picture: both cameras' images side by side, boards taken so far in green, the one seen now in orange.

    images: as the cameras give them; taken: outlines (4 x 2 pixels) for each camera; seen: one each, or None.
    """
    panes = [_pane(*camera) for camera in zip(images, taken, seen)]
    picture = np.hstack([panes[0], np.zeros((HEIGHT, 4, 3), np.uint8), panes[1]])
    text = np.zeros((LINE * len(lines) + 8, picture.shape[1], 3), np.uint8)
    for number, line in enumerate(lines):
        cv2.putText(text, line, (8, LINE * (number + 1) - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.55, INK, 1, cv2.LINE_AA)
    return np.vstack([picture, text])


def _pane(image, taken, seen):
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
