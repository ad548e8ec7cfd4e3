# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Depth borders over the colour picture, for people."""
import cv2
import numpy as np

NEAR, FAR = (0, 140, 255), (255, 120, 40)  # BGR: orange, blue
DIM = 0.75
LINE = 24  # pixels


def overlay(image, contours, lines):
    """BGR picture with the borders of near things in orange, where the far side begins in blue, and lines of text."""
    shown = (image * DIM).astype(np.uint8)
    radius = max(0, round(image.shape[1] / 1000))
    for points, color in ((contours.far, FAR), (contours.at, NEAR)):
        for x, y in np.rint(points).astype(int):
            cv2.circle(shown, (int(x), int(y)), radius, color, -1)
    size = max(1.0, image.shape[1] / 1000)
    step = round(LINE * size)
    legend = ["orange: border of what is near; blue: where the far side begins"] + lines
    text = np.zeros((step * len(legend) + 8, image.shape[1], 3), np.uint8)
    for number, line in enumerate(legend):
        width = cv2.getTextSize(line, cv2.FONT_HERSHEY_SIMPLEX, 0.5 * size, 1)[0][0]
        fitted = 0.5 * size * min(1, (image.shape[1] - 12) / max(1, width))
        cv2.putText(text, line, (6, step * (number + 1) - 6), cv2.FONT_HERSHEY_SIMPLEX, fitted, (230, 230, 230),
                    max(1, round(size)), cv2.LINE_AA)
    return np.vstack([shown, text])
