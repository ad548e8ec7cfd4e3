# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rockinger, "Image sequence fusion using a shift-invariant wavelet transform", ICIP 1997: undecimated Haar wavelets.

The paper's comparison calls it DWT. Detail coefficients come from the image where they are greatest, of equal ones from
the last; the coarsest approximation is the mean.
"""
import numpy as np
import pywt

from all_in_focus_lab.baselines.common import choose, grays_of, to_8_bit

LEVELS = 4
MARGIN = 2 ** LEVELS  # pixels, at least the reach of the wavelets: the transform wraps around
# Means and half differences, which are exact: the rounding of factors of the root of 2 would decide between equal ones.
HAAR = pywt.Wavelet("Haar of means", filter_bank=([0.5, 0.5], [-0.5, 0.5], [1, 1], [1, -1]))


def transform(image):
    """Of H x W, mirrored beyond its border: for each level, the coarsest first, approximation and three details."""
    margins = [(MARGIN, MARGIN - size % MARGIN) for size in image.shape]
    return pywt.swt2(np.pad(image.astype(np.float64), margins, mode="symmetric"), HAAR, LEVELS)


def fuse(images):
    """See all_in_focus_lab.baselines; returns no weights."""
    height, width = images[0].shape[:2]
    grays = [transform(gray) for gray in grays_of(images)]
    winners = [[len(images) - 1 - np.argmax([np.abs(of[level][1][band]) for of in grays[::-1]], axis=0)
                for band in range(3)] for level in range(LEVELS)]
    channels = []
    for channel in range(3):
        bands = [transform(image[..., channel]) for image in images]
        mean = sum(of[0][0] for of in bands) / len(bands)
        fused = [(mean, tuple(choose([of[level][1][band] for of in bands], winners[level][band]) for band in range(3)))
                 for level in range(LEVELS)]
        channels.append(pywt.iswt2(fused, HAAR)[MARGIN:MARGIN + height, MARGIN:MARGIN + width])
    return to_8_bit(np.dstack(channels)), None
