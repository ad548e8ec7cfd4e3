# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Metric of preserved edges: Q_G."""
import cv2
import numpy as np
from scipy.special import expit

from all_in_focus_lab.metrics.images import remembered

FLOOR = 1e-5                             # stands for a gradient of zero
STRENGTH_SLOPE, STRENGTH_MIDDLE = 10, 0.5
ANGLE_SLOPE, ANGLE_MIDDLE = 20, 0.75


def gradient(gray):
    """Sobel gradient of H x W, zeros outside: magnitude, and direction in -pi/2..pi/2."""
    dx, dy = (cv2.Sobel(np.float64(gray), cv2.CV_64F, *order, borderType=cv2.BORDER_CONSTANT)
              for order in ((1, 0), (0, 1)))
    return np.sqrt(dx ** 2 + dy ** 2), np.arctan(dy / np.where(dx == 0, FLOOR, dx))


_source_gradient = remembered(gradient)


def q_g(sources, fused):
    """Xydeas, Petrovic, "Objective image fusion performance measure", Electronics Letters 36(4), 2000. Arguments: see
    the package. Range 0..1, 0.987 at most.

    Edge strength and direction that are preserved, per pixel the mean of the sources weighted by their gradients,
    then the plain mean over the pixels, flat ones included. More sources: more terms in the weighted mean.
    """
    magnitude, direction = gradient(fused)
    weighted, weights = 0.0, 0.0
    for source in sources:
        source_magnitude, source_direction = _source_gradient(source)
        weight = np.where(source_magnitude == 0, FLOOR, source_magnitude)
        floored = np.where(magnitude == 0, FLOOR, magnitude)
        strength = np.where(source_magnitude > magnitude, magnitude / weight, weight / floored)
        magnitude = floored  # from then on for all sources: so it is in the published values
        angle = np.abs(np.abs(source_direction - direction) - np.pi / 2) * 2 / np.pi
        preserved = expit(STRENGTH_SLOPE * (strength - STRENGTH_MIDDLE)) * expit(ANGLE_SLOPE * (angle - ANGLE_MIDDLE))
        weighted, weights = weighted + preserved * weight, weights + weight
    return float((weighted / weights).mean())
