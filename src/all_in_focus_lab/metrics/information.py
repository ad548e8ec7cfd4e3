# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Metrics from the joint histograms of gray values: Q_MI and Q_NCIE."""
from itertools import combinations

import numpy as np
from scipy.stats import entropy

from all_in_focus_lab.metrics.images import stretched

LEVELS = 256


def information(one, other):
    """Entropy of two images (integer values 0..255) and the mutual information, bits."""
    bins = np.int64(one).ravel() * LEVELS + np.int64(other).ravel()
    joint = np.bincount(bins, minlength=LEVELS ** 2).reshape(LEVELS, LEVELS) / one.size
    entropies = entropy(joint.sum(axis=1), base=2), entropy(joint.sum(axis=0), base=2)
    return entropies, sum(entropies) - entropy(joint.ravel(), base=2)


def q_mi(sources, fused):
    """Hossny, Nahavandi, Creighton, "Comments on 'Information measure for performance of image fusion'", Electronics
    Letters 44(18), 2008. Arguments: see the package. Range 0..2.

    Mutual information of each source with the fused image over the mean of their entropies. More sources: the mean
    over all pairs of sources.
    """
    fused, total = stretched(fused), 0.0
    for source in sources:
        entropies, shared = information(stretched(source), fused)
        total += 2 * shared / sum(entropies) if sum(entropies) > 0 else 0.0
    return float(2 * total / len(sources))


def q_ncie(sources, fused):
    """Wang, Shen, Jin, "Performance evaluation of image fusion techniques", in Image Fusion, ed. Stathaki, 2008.
    Arguments: see the package. Range 0..1.

    One less the entropy of the eigenvalues of the nonlinear correlation matrix of sources and fused image; more
    sources: the matrix grows, as in the paper.
    """
    images = [stretched(image) for image in (*sources, fused)]
    correlation = np.eye(len(images))
    for i, j in combinations(range(len(images)), 2):
        correlation[i, j] = correlation[j, i] = information(images[i], images[j])[1] / np.log2(LEVELS)
    # Equal images have eigenvalues 0, which may come out a little below.
    return float(1 - entropy(np.maximum(np.linalg.eigvalsh(correlation), 0), base=LEVELS))
