# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Qu, Yan, Xiao, Zhu, "Image fusion algorithm based on spatial frequency-motivated pulse coupled neural networks in
nonsubsampled contourlet transform domain", Acta Automatica Sinica 34(12), 2008.

In every subband each pixel is a neuron fed by the local spatial frequency and linked to its neighbours; the image whose
neuron fires most often gives the coefficient, of equal ones the first. The transform is that of contourlet.py.
"""
import cv2
import numpy as np

from all_in_focus.baselines import contourlet

WINDOW = 3                              # pixels, of the spatial frequency
LINK_DECAY, THRESHOLD_DECAY = 0.06931, 0.2
LINK_GAIN, THRESHOLD_GAIN, LINKING = 1.0, 20.0, 0.2
NEIGHBOURS = np.float32([[0.5 ** 0.5, 1, 0.5 ** 0.5], [1, 0, 1], [0.5 ** 0.5, 1, 0.5 ** 0.5]])
STEPS = 200


def spatial_frequency(band):
    """Root of the mean squared difference to the neighbours above and to the left, float32, for gray values 0..1."""
    squares = np.zeros_like(band)
    squares[:, 1:] += np.diff(band, axis=1) ** 2
    squares[1:] += np.diff(band, axis=0) ** 2
    return np.float32(np.sqrt(cv2.blur(squares, (WINDOW, WINDOW))) / 255)


def firing_counts(stimulus):
    """How often each neuron fires; stimulus: H x W float32."""
    link, threshold, fires, count = np.zeros((4,) + stimulus.shape, np.float32)
    for _ in range(STEPS):
        link = np.float32(np.exp(-LINK_DECAY)) * link + LINK_GAIN * cv2.filter2D(fires, -1, NEIGHBOURS)
        threshold = np.float32(np.exp(-THRESHOLD_DECAY)) * threshold + THRESHOLD_GAIN * fires
        fires = np.float32(stimulus * (1 + LINKING * link) > threshold)
        count += fires
    return count


def fuse(images):
    """See all_in_focus.baselines; tells no weights."""
    def choice(subbands, _):
        return np.argmax([firing_counts(spatial_frequency(band)) for band in subbands], axis=0)

    return contourlet.fuse_by(images, choice), None
