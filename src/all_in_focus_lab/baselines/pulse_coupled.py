# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Qu, Yan, Xiao, Zhu, "Image fusion algorithm based on spatial frequency-motivated pulse coupled neural networks in
nonsubsampled contourlet transform domain", Acta Automatica Sinica 34(12), 2008.

In every subband each pixel is a neuron fed by the local spatial frequency and linked to its neighbours; the image whose
neuron fires most often gives the coefficient, of equal ones the first.

The transform is that of da Cunha, Zhou, Do, IEEE Transactions on Image Processing 15(10), 2006: a pyramid without
subsampling, its low passes maximally flat, each level split by direction with ladder filters (Phoong, Kim, Vaidyanathan,
Ansari 1995). All filters are real, and applied in the frequency domain.
"""
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from all_in_focus_lab.baselines.common import choose, grays_of, spatial_frequency, to_8_bit

DIRECTIONS = (4, 4, 3, 1, 0)  # log2 of their number, finest level first
MARGIN = 32                   # pixels, mirrored: the FFT wraps around
LADDER = (0.63, -0.193, 0.0972, -0.0526, 0.0272, -0.0144)  # half of the symmetric filter
ROOT = 2 ** 0.5
WINDOW = 3                              # pixels, of the spatial frequency
LINK_DECAY, THRESHOLD_DECAY = 1.0, 0.2  # those of links and LINKING: of the authors' program; the paper has 0.06931, 0.2
LINK_GAIN, THRESHOLD_GAIN, LINKING = 1.0, 20.0, 3.0
NEIGHBOURS = np.float32([[0.5 ** 0.5, 1, 0.5 ** 0.5], [1, 0, 1], [0.5 ** 0.5, 1, 0.5 ** 0.5]])
STEPS = 200


# --- the transform ----------------------------------------------------------------------------------------------------

def low_pass(frequency):
    """Maximally flat half-band low pass along one axis; frequencies: radians per pixel."""
    return (16 + 18 * np.cos(frequency) - 2 * np.cos(3 * frequency)) / 32


def narrow(x):
    """From -1 to 1 it rises from 0 to 1, as `wide` does; narrow(x) wide(x) + narrow(-x) wide(-x) = 1."""
    return (1 + x) / 2 * (ROOT + (1 - ROOT) * x)


def wide(x):
    return (1 + x) / 2 * (ROOT + (4 - 3 * ROOT) * x + (2 * ROOT - 3) * x ** 2)


def diamond(y, x):
    """(filter of analysis, of synthesis) of a low and a high pass; the low pass has |y| + |x| < pi."""
    def allpass(angle):
        return sum(2 * tap * np.cos((number + 0.5) * angle) for number, tap in enumerate(LADDER))

    s = allpass(y + x) * allpass(y - x)
    return ((1 + s) / 2, 1 + s * (1 - s) / 2), (1 - s * (1 + s) / 2, (1 - s) / 2)


def branch(y, x, level, number):
    """The two filters that split subband `number` of a level of the tree of directions."""
    if level == 0:
        return diamond(y, x + np.pi)
    if level == 1:
        return diamond(y + x, x - y + np.pi)
    half, scale = 2 ** (level - 1), 2 ** (level - 2)
    if number >= half:
        y, x, number = x, y, number - half
    y, x = 2 * (scale * y - (2 * (number // 2) + 1 - scale) * x), 2 * x
    return diamond(y, x - y + np.pi) if number % 2 else diamond(y + np.pi, x + y)


def directions(y, x, levels):
    """(filter of analysis, of synthesis) of 2 ** levels directions."""
    found = [(1.0, 1.0)]
    for level in range(levels):
        found = [(one * further, other * back) for number, (one, other) in enumerate(found)
                 for further, back in branch(y, x, level, number)]
    return found


def filters(shape):
    """(filter of analysis, of synthesis) of all subbands in the order of rfft2, the coarsest last."""
    y, x = 2 * np.pi * np.fft.fftfreq(shape[0])[:, None], 2 * np.pi * np.fft.rfftfreq(shape[1])[None]
    rest = back = 1.0
    for level, count in enumerate(DIRECTIONS):
        flat = 2 * low_pass(2 ** level * y) * low_pass(2 ** level * x) - 1
        for one, other in directions(y, x, count):
            yield rest * wide(-flat) * one, back * narrow(-flat) * other
        rest, back = rest * narrow(flat), back * wide(flat)
    yield rest, back


# --- the neurons ------------------------------------------------------------------------------------------------------

def stimulus_of(band):
    """Root of the spatial frequency, float32, for gray values 0..1."""
    return np.float32(np.sqrt(spatial_frequency(band, WINDOW)) / 255)


def firing_counts(stimulus, link_decay=LINK_DECAY, linking=LINKING):
    """How often each neuron fires; stimulus: H x W float32."""
    # In place, by OpenCV: memory traffic takes most of the time.
    link, threshold, fires, around, count = np.zeros((5,) + stimulus.shape, np.float32)
    linked = np.float32(linking) * stimulus
    for _ in range(STEPS):
        cv2.filter2D(fires, -1, LINK_GAIN * NEIGHBOURS, dst=around)
        cv2.addWeighted(link, np.exp(-link_decay), around, 1, 0, dst=link)
        cv2.addWeighted(threshold, np.exp(-THRESHOLD_DECAY), fires, THRESHOLD_GAIN, 0, dst=threshold)
        cv2.multiply(linked, link, dst=fires)
        cv2.add(fires, stimulus, dst=fires)
        cv2.subtract(fires, threshold, dst=fires)
        cv2.threshold(fires, 0, 1, cv2.THRESH_BINARY, dst=fires)
        cv2.add(count, fires, dst=count)
    return count


def fuse(images):
    """See all_in_focus_lab.baselines; returns no weights."""
    margins = ((MARGIN, MARGIN), (MARGIN, MARGIN))
    shape = tuple(size + 2 * MARGIN for size in images[0].shape[:2])

    def spectrum(image):
        return np.fft.rfft2(np.pad(image, margins + ((0, 0),) * (image.ndim - 2), mode="symmetric"), axes=(0, 1))

    grays, colours = [spectrum(gray) for gray in grays_of(images)], [spectrum(np.float64(image)) for image in images]
    fused = 0
    with ThreadPoolExecutor() as pool:  # OpenCV releases the interpreter lock
        for analysis, synthesis in filters(shape):
            stimuli = [stimulus_of(np.fft.irfft2(gray * analysis, shape)) for gray in grays]
            index = np.argmax(list(pool.map(firing_counts, stimuli)), axis=0)
            subbands = [np.fft.irfft2(colour * analysis[..., None], shape, axes=(0, 1)) for colour in colours]
            fused = fused + np.fft.rfft2(choose(subbands, index), axes=(0, 1)) * synthesis[..., None]
    return to_8_bit(np.fft.irfft2(fused, shape, axes=(0, 1))[MARGIN:-MARGIN, MARGIN:-MARGIN]), None
