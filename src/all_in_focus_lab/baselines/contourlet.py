# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Zhang, Guo, "Multifocus image fusion using the nonsubsampled contourlet transform", Signal Processing 89(7), 2009.

The paper's comparison calls it NSCT, but its images come from the contourlet transform with subsampling (Do, Vetterli
2005): a Laplacian pyramid, each level split by direction with the ladder filters of Phoong, Kim, Vaidyanathan and
Ansari (1995). Directional coefficients come from the image with most energy around them, those at the border of a
subband from the last image; the coarsest level is the mean.
"""
import numpy as np
import pywt
from scipy.ndimage import convolve1d, correlate

from all_in_focus_lab.baselines.common import choose, grays_of, to_8_bit

DIRECTIONS = (6, 5, 3, 1)  # log2 of their number, finest level first
SIDE = 32                  # pixels; the transform takes sides that are multiples of it
NEIGHBOURS = np.array([[0.6, 0.8, 0.6], [0.8, 1, 0.9], [0.6, 0.8, 0.6]])  # of the energy; not symmetric, as published
BIORTHOGONAL = pywt.Wavelet("bior4.4")
ANALYSIS, SYNTHESIS = BIORTHOGONAL.dec_lo[1:], BIORTHOGONAL.rec_lo[1:-2]  # low passes of 9 and 7 taps
LADDER = (0.63, 0.193, 0.0972, 0.0526, 0.0272, 0.0144)  # half of the antisymmetric filter between two pixels
TAPS = np.array(LADDER[::-1] + tuple(-tap for tap in LADDER))


# --- pyramid: arrays are H x W or H x W x C, and wrap around ----------------------------------------------------------

def low_pass(image, taps):
    return convolve1d(convolve1d(image, taps, axis=0, mode="wrap"), taps, axis=1, mode="wrap")


def expand(coarse):
    """Image of twice the size."""
    image = np.zeros((2 * coarse.shape[0], 2 * coarse.shape[1]) + coarse.shape[2:])
    image[::2, ::2] = coarse
    return low_pass(image, SYNTHESIS)


def shrink(image):
    """Image of half the size."""
    return low_pass(image, ANALYSIS)[::2, ::2]


# --- directions -------------------------------------------------------------------------------------------------------

def phases(shape, kind):
    """Rows and columns of either half of the pixels of an H x W array, each H / 2 x W.

    kind 0: the colours of a checkerboard, turned by 45 degrees; 1, 2: every other row, sheared to one side or the other.
    """
    height, width = shape
    row, column = np.indices((height // 2, width), sparse=True)
    places = []
    for phase in (0, 1):
        rows, columns = 2 * row + phase, (column - row if kind == 2 else column + row + phase) % width
        places.append(((rows - columns) % height if kind == 0 else rows, columns))
    return places


def ladder(values, before, twist):
    """`values` filtered along both axes, `before` taps above and left of a pixel.

    twist: half the width away beyond the upper and lower border, as checkerboards of square images go on.
    """
    height, width = values.shape[:2]
    rows = np.arange(-before, height + len(TAPS) - 1 - before)
    extended = values[rows % height]
    if twist:
        beyond = rows // height % 2 == 1
        extended[beyond] = np.roll(extended[beyond], width // 2, axis=1)
    first = len(LADDER) - 1
    return convolve1d(convolve1d(extended, TAPS, axis=0, mode="constant")[first:first + height], TAPS, axis=1,
                      mode="wrap", origin=first - before)


def split(image, kind, twist=False):
    """High and low subband, each of half the height."""
    even, odd = (image[place] for place in phases(image.shape[:2], kind))
    low = (even - ladder(odd, len(LADDER), twist)) / 2 ** 0.5
    return [-2 ** 0.5 * odd - ladder(low, len(LADDER) - 1, twist), low]


def join(high, low, kind, twist=False):
    """Inverse of `split`."""
    odd = -(high + ladder(low, len(LADDER) - 1, twist)) / 2 ** 0.5
    even = 2 ** 0.5 * low + ladder(odd, len(LADDER), twist)
    image = np.empty((2 * low.shape[0],) + low.shape[1:])
    for place, half in zip(phases(image.shape[:2], kind), (even, odd)):
        image[place] = half
    return image


def upright(shape, levels, number):
    """Rows and columns of the coefficients of a subband, H x W, so that neighbours lie as in the image."""
    row, column = np.indices(shape, sparse=True)
    if levels == 1:
        row = (row + column // 2) % shape[0]
        return row, (column - row) % shape[1]
    return row, (column + (2 * (number // 2) + 1 - 2 ** (levels - 2)) * row) % shape[1]


def turned(bands):
    return [np.swapaxes(band, 0, 1) for band in bands]


def fan(bands, levels):
    """The subbands of half of the directions, or of all of 2, from what the first splits gave."""
    for _ in range(2, levels):
        bands = [band for number, whole in enumerate(bands) for band in split(whole, 1 + number % 2)]
    return [band[upright(band.shape[:2], levels, number)] for number, band in enumerate(bands)]


def fan_closed(subbands, levels):
    """Inverse of `fan`."""
    bands = [np.empty_like(subband) for subband in subbands]
    for number, (band, subband) in enumerate(zip(bands, subbands)):
        band[upright(band.shape[:2], levels, number)] = subband
    for _ in range(2, levels):
        bands = [join(*pair, 1 + number % 2) for number, pair in enumerate(zip(bands[::2], bands[1::2]))]
    return bands


def directions(image, levels):
    """2 ** levels subbands of an image: first those of steep edges, then those of flat ones."""
    flat, steep = split(image, 0, twist=True)
    if levels == 1:
        return fan([steep, flat], levels)
    return fan(turned(split(*turned([steep]), 0)), levels) + turned(fan(split(*turned([flat]), 0), levels))


def undirected(subbands):
    """Inverse of `directions`."""
    half = len(subbands) // 2
    levels = half.bit_length()
    if levels == 1:
        steep, flat = fan_closed(subbands, levels)
    else:
        steep, flat = turned([join(*turned(fan_closed(subbands[:half], levels)), 0),
                              join(*fan_closed(turned(subbands[half:]), levels), 0)])
    return join(flat, steep, 0, twist=True)


# --- the transform ----------------------------------------------------------------------------------------------------

def transform(image):
    """(coarsest level, for each level, the finest first, its subbands); the sides must be multiples of SIDE."""
    levels = []
    for count in DIRECTIONS:
        coarse = shrink(image)
        levels.append(directions(image - expand(coarse), count))
        image = coarse
    return image, levels


def inverse(coarsest, levels):
    """The image of which `transform` gives this."""
    image = coarsest
    for subbands in levels[::-1]:
        detail = undirected(subbands)
        image = expand(image - shrink(detail)) + detail
    return image


def winner(subbands):
    """Which image has most energy around a coefficient, as an index image; the last at the border."""
    index = np.argmax([correlate(band * band, NEIGHBOURS, mode="constant") for band in subbands], axis=0)
    index[[0, -1]] = index[:, [0, -1]] = len(subbands) - 1
    return index


def margins(shape):
    """Rows and columns to add before and after: none, as published, where the sides are multiples of SIDE."""
    if all(size % SIDE == 0 for size in shape):
        return [(0, 0), (0, 0)]
    return [(SIDE, SIDE + -size % SIDE) for size in shape]


def fuse(images):
    """See all_in_focus_lab.baselines; returns no weights."""
    around = margins(images[0].shape[:2])

    def transformed(image):
        return transform(np.pad(image.astype(np.float64), around + [(0, 0)] * (image.ndim - 2), mode="symmetric"))

    grays = [transformed(gray)[1] for gray in grays_of(images)]
    coarsest, colours = zip(*map(transformed, images))
    fused = inverse(sum(coarsest) / len(images), [
        [choose(coloured, winner(subbands)) for subbands, coloured in zip(zip(*of_gray), zip(*of_colour))]
        for of_gray, of_colour in zip(zip(*grays), zip(*colours))])
    height, width = images[0].shape[:2]
    return to_8_bit(fused[around[0][0]:, around[1][0]:][:height, :width]), None
