# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The nonsubsampled contourlet transform, after da Cunha, Zhou, Do, IEEE Transactions on Image Processing 15(10), 2006.

A pyramid without subsampling, each level split by direction. Here the filters are made in the frequency domain,
maximally flat low passes and smooth wedges that sum to 1, so that the sum of all subbands is the image.
"""
import numpy as np

from all_in_focus.baselines.common import choose, grays_of, to_8_bit

DIRECTIONS = (4, 4, 4)  # finest level first
MARGIN = 32             # pixels, mirrored: the FFT wraps around


def smooth_step(x):
    """0 below 0, 1 above 1, two derivatives continuous."""
    x = np.clip(x, 0, 1)
    return x ** 3 * (10 - 15 * x + 6 * x ** 2)


def low_pass(frequency, step):
    """Maximally flat half-band low pass along one axis, its taps `step` pixels apart."""
    return smooth_step((1 + np.cos(2 * np.pi * frequency * step)) / 2)


def wedges(y, x, count):
    """Filters of `count` directions with sum 1; y, x: frequencies."""
    sector = np.arctan2(y, x) / np.pi * count
    for k in range(count):
        distance = np.abs((sector - k - 0.5 + count / 2) % count - count / 2)
        yield np.cos(np.pi / 2 * smooth_step(2 * distance - 0.5)) ** 2


def filters(shape):
    """Of all subbands in the order of rfft2, the coarsest last; they sum to 1."""
    y, x = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None]
    rest = np.ones((shape[0], x.size))
    for level, count in enumerate(DIRECTIONS):
        coarse = rest * low_pass(y, 2 ** level) * low_pass(x, 2 ** level)
        yield from ((rest - coarse) * wedge for wedge in wedges(y, x, count))
        rest = coarse
    yield rest


def fuse_by(images, choice):
    """Fused uint8 image; choice(gray subbands, is it the coarsest) gives the index of the image to take, None: mean."""
    margins = ((MARGIN, MARGIN), (MARGIN, MARGIN))
    shape = tuple(size + 2 * MARGIN for size in images[0].shape[:2])

    def spectrum(image):
        return np.fft.rfft2(np.pad(image, margins + ((0, 0),) * (image.ndim - 2), mode="symmetric"), axes=(0, 1))

    grays, colours = [spectrum(gray) for gray in grays_of(images)], [spectrum(np.float64(image)) for image in images]
    fused, bands = 0, list(filters(shape))
    for number, band in enumerate(bands):
        index = choice([np.fft.irfft2(gray * band, shape) for gray in grays], number == len(bands) - 1)
        subbands = [np.fft.irfft2(colour * band[..., None], shape, axes=(0, 1)) for colour in colours]
        fused = fused + (sum(subbands) / len(subbands) if index is None else choose(subbands, index))
    return to_8_bit(fused[MARGIN:-MARGIN, MARGIN:-MARGIN])
