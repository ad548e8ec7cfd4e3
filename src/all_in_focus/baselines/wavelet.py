# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rockinger, "Image sequence fusion using a shift-invariant wavelet transform", ICIP 1997: undecimated Haar wavelets.

The paper's comparison calls it DWT. Detail coefficients come from the image where they are greatest, of equal ones from
the last; the coarsest approximation is the mean.

Not by PyWavelets: its coefficients are scaled by the root of 2, whose rounding decides between equal ones, so that 3 %
of the pixels differ from the published image.
"""
import numpy as np

from all_in_focus.baselines.common import choose, grays_of, to_8_bit

LEVELS = 4
MARGIN = 2 ** LEVELS  # pixels, at least the reach of the wavelets: np.roll wraps around


def split(image, step, axis):
    """Low and high pass."""
    ahead = np.roll(image, -step, axis)
    return (image + ahead) / 2, (image - ahead) / 2


def join(low, high, step, axis):
    """Mean of the two ways to invert `split`."""
    return (low + high + np.roll(low - high, step, axis)) / 2


def decompose(image, step):
    """Approximation and three details, along columns and rows."""
    low, high = split(image, step, 0)
    return [*split(low, step, 1), *split(high, step, 1)]


def compose(bands, step):
    return join(join(*bands[:2], step, 1), join(*bands[2:], step, 1), step, 0)


def _fuse_level(grays, images, level):
    """Fused approximation from this level on."""
    if level == LEVELS:
        return sum(images) / len(images)
    gray_bands, bands = ([decompose(image, 2 ** level) for image in of] for of in (grays, images))
    fused = [_fuse_level([of[0] for of in gray_bands], [of[0] for of in bands], level + 1)]
    for band in (1, 2, 3):
        greatest = np.argmax([np.abs(of[band]) for of in gray_bands[::-1]], axis=0)
        fused.append(choose([of[band] for of in bands], len(images) - 1 - greatest))
    return compose(fused, 2 ** level)


def fuse(images):
    """See all_in_focus.baselines; tells no weights."""
    margins = ((MARGIN, MARGIN), (MARGIN, MARGIN))
    grays = [np.pad(gray, margins, mode="symmetric") for gray in grays_of(images)]
    images = [np.pad(np.float64(image), margins + ((0, 0),), mode="symmetric") for image in images]
    return to_8_bit(_fuse_level(grays, images, 0)[MARGIN:-MARGIN, MARGIN:-MARGIN]), None
