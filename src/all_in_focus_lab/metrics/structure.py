# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Metric of structural similarity: Q_Y."""
from itertools import combinations

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from all_in_focus_lab.metrics.images import Local, ratio, remembered

SIZE, SIGMA = 7, 1.5  # pixels, of the Gaussian window
C = 2e-16             # of SSIM, twice; keeps 0 / 0 away
ALIKE = 0.75          # sources at least so similar are weighted, of others the better counts


class _Windows(Local):
    """Every window of SIZE x SIZE pixels of a gray image; constant: those of one value."""

    def __init__(self, gray):
        super().__init__(gray, SIZE, SIGMA)
        self.constant = maximum_filter(gray, SIZE) == minimum_filter(gray, SIZE)
        # Exactly 0 in constant windows: rounding noise is far above C.
        self.variance = np.where(self.constant, 0, np.maximum(self.variance, 0))

    def similarity(self, other):
        """SSIM of every window, -1..1."""
        covariance = np.where(self.constant | other.constant, 0, self.covariance(other))
        luminance = (2 * self.mean * other.mean + C) / (self.mean ** 2 + other.mean ** 2 + C)
        return luminance * (2 * covariance + C) / (self.variance + other.variance + C)


@remembered
def _of_sources(*sources):
    """_Windows of each; and of each window: are they alike, how much does each count, are all of them 0."""
    windows = [_Windows(source) for source in sources]
    alike = np.min([one.similarity(other) for one, other in combinations(windows, 2)], axis=0) >= ALIKE
    variances = np.array([window.variance for window in windows])
    share = ratio(variances, np.broadcast_to(variances.sum(axis=0), variances.shape), 1 / len(sources))
    return windows, alike, share, np.all([window.constant & (window.mean == 0) for window in windows], axis=0)


def q_y(sources, fused):
    """Yang, Zhang, Wang, Li, "A novel similarity based quality metric for image fusion", Information Fusion 9(2), 2008.
    Arguments: see the package. Range -1..1.

    Where the sources are alike, their similarity to the fused image weighted by variance, elsewhere that of the most
    similar one. More sources: they are alike where every pair is. Windows in which all sources are 0 are left out.

    In constant windows variances are rounding noise far above the metric's constants; here they are exactly 0 there.
    Published values, which have the noise, differ by up to 5e-4.
    """
    windows, alike, share, empty = _of_sources(*sources)
    target = _Windows(fused)
    similar = np.array([window.similarity(target) for window in windows])
    quality = np.where(alike, (share * similar).sum(axis=0), similar.max(axis=0))
    inside = (slice(SIZE // 2, -(SIZE // 2)),) * 2  # windows that lie in the image as a whole
    quality, empty = quality[inside], empty[inside]
    return float(quality[~empty].mean()) if not empty.all() else float("nan")
