# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Felzenszwalb and Huttenlocher's segmentation of a depth map, and which regions fit one depth of field: tables T1 and
T2 of the paper, for any depth map and for the labels of any segmentation."""
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from skimage.segmentation import felzenszwalb


@dataclass
class Region:
    """area in pixels; extremes of depth and the greatest span that fits, mm (infinite beyond hyperfocal)."""
    area: int
    min_mm: int
    max_mm: int
    max_dof_mm: float

    @property
    def diff_mm(self):
        return self.max_mm - self.min_mm

    @property
    def fits(self):
        return self.diff_mm < self.max_dof_mm


def max_dof(optics, min_mm, max_mm):
    """MaxDoF in mm, the larger one of b_DoF(Min) and f_DoF(Max): equations 9 and 10."""
    blur = optics.aperture * optics.circle_of_confusion_mm
    behind = optics.focal_length_mm ** 2 - blur * min_mm  # not positive beyond the hyperfocal distance
    back = blur * min_mm ** 2 / behind if behind > 0 else np.inf
    return max(back, blur * max_mm ** 2 / (optics.focal_length_mm ** 2 + blur * max_mm))


def graph_segmentation(depth, scale_mm, sigma, min_size):
    """Labels (H x W int32, 0 = depth unknown) of a depth map (H x W uint16, mm, 0 = unknown).

    scale_mm: k of the criterion k/|C|, in mm; sigma: of the Gaussian beforehand, pixels; min_size: smaller regions are
    merged. Unknown pixels get the depth of the nearest known one, so that they neither part regions nor join them.
    """
    known = depth > 0
    if not known.any():
        return np.zeros(depth.shape, np.int32)
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled = depth[tuple(nearest)].astype(np.float64)
    labels = felzenszwalb(filled, scale=255 * scale_mm, sigma=sigma, min_size=min_size)  # it divides the scale by 255
    return np.where(known, labels + 1, 0).astype(np.int32)


def regions(labels, depth, optics):
    """Region of each label but 0, the nearest (by median depth) first."""
    known, areas = np.unique(labels[labels != 0], return_counts=True)
    medians, lows, highs = (of(depth.astype(float), labels, known) for of in (ndimage.median, ndimage.minimum, ndimage.maximum))
    return [Region(int(area), int(low), int(high), max_dof(optics, int(low), int(high)))
            for _, _, area, low, high in sorted(zip(medians, known, areas, lows, highs))]


def cells(found, count):
    """Table of the `count` largest regions as lists of text, nearest first; mm."""
    largest = set(sorted(range(len(found)), key=lambda n: -found[n].area)[:count])
    lines = [["region", "pixels", "Min", "Max", "Diff", "MaxDoF", "Diff < MaxDoF?"]]
    for number, it in enumerate(region for n, region in enumerate(found) if n in largest):
        dof = "infinite" if np.isinf(it.max_dof_mm) else f"{it.max_dof_mm:.0f}"
        lines.append([str(number + 1), str(it.area), str(it.min_mm), str(it.max_mm), str(it.diff_mm), dof,
                      "yes" if it.fits else "no"])
    return lines


def summary(found):
    """How many regions, and how many pixels, fit one depth of field."""
    total, fit = sum(it.area for it in found), sum(it.area for it in found if it.fits)
    return (f"{sum(it.fits for it in found)} of {len(found)} regions fit one depth of field: {100 * fit / max(1, total):.1f} % "
            "of the known pixels")
