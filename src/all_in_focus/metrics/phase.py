# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Metric of preserved features: Q_P."""
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from all_in_focus.metrics.images import gaussian, remembered, windowed
from all_in_focus.metrics.phase_congruency import phase_congruency

SIZE, SIGMA = 11, 1.5  # pixels, of the Gaussian window
FEATURE = 0.1          # phase congruency above which a pixel counts
C = 1e-4


class _Map:
    """One feature map with its local mean and variance."""

    def __init__(self, values):
        self.values, self.mean = values, local_mean(values)
        self.variance = local_mean(values ** 2) - self.mean ** 2

    def correlation(self, other):
        covariance = local_mean(self.values * other.values) - self.mean * other.mean
        return (covariance + C) / (np.sqrt(np.abs(self.variance * other.variance)) + C)


def local_mean(values):
    return windowed(values, gaussian(SIZE, SIGMA))


def q_p(sources, fused):
    """Zhao, Laganiere, Liu, "Performance assessment of combinative pixel-level image fusion based on an absolute
    feature measurement", International Journal of Innovative Computing, Information and Control 3(6A), 2007. Arguments:
    see the package. Range 0..1.

    Product of three numbers, one each for phase congruency and its two moments: the local correlation of the fused map
    with that of the source, or of the strongest source, that correlates best, over the pixels that have features. More
    sources: more to choose from.
    """
    masks, maps = _masks_and_maps(*sources)
    count = masks[-1].sum()
    if count == 0:
        return float("nan")
    product = 1.0
    for of_sources, values in zip(maps, phase_congruency(fused)):
        target = _Map(values)
        best = np.max([mask * source.correlation(target) for source, mask in zip(of_sources, masks)], axis=0)
        product *= best.sum() / count
    return float(product)


@remembered
def _masks_and_maps(*sources):
    """For each source, and for the image made of the strongest source at each pixel: a mask of the pixels with features,
    and the _Maps by kind."""
    with ThreadPoolExecutor() as pool:  # numpy releases the interpreter lock
        maps = np.array(list(pool.map(phase_congruency, sources)))
    # Of equally strong sources the last.
    strongest = len(sources) - 1 - maps[::-1, 0].argmax(axis=0)
    maps = np.concatenate([maps, np.take_along_axis(maps, strongest[None, None], axis=0)])
    masks = maps[:, 0] > FEATURE
    return masks, [[_Map(source[kind] * mask) for source, mask in zip(maps, masks)] for kind in range(maps.shape[1])]
