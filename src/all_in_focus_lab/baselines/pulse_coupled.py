# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Qu, Yan, Xiao, Zhu, "Image fusion algorithm based on spatial frequency-motivated pulse coupled neural networks in
nonsubsampled contourlet transform domain", Acta Automatica Sinica 34(12), 2008.

In every subband each pixel is a neuron fed by the local spatial frequency and linked to its neighbours; the image whose
neuron fires most often gives the coefficient, of equal ones the first. The transform is that of nonsubsampled.py.
"""
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from all_in_focus_lab.baselines import nonsubsampled
from all_in_focus_lab.baselines.common import spatial_frequency

WINDOW = 3                              # pixels, of the spatial frequency
LINK_DECAY, THRESHOLD_DECAY = 1.0, 0.2  # those of links and LINKING: of the authors' program; the paper has 0.06931, 0.2
LINK_GAIN, THRESHOLD_GAIN, LINKING = 1.0, 20.0, 3.0
NEIGHBOURS = np.float32([[0.5 ** 0.5, 1, 0.5 ** 0.5], [1, 0, 1], [0.5 ** 0.5, 1, 0.5 ** 0.5]])
STEPS = 200


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
    def choice(subbands):
        return np.argmax(list(pool.map(firing_counts, map(stimulus_of, subbands))), axis=0)

    with ThreadPoolExecutor() as pool:  # OpenCV releases the interpreter lock
        return nonsubsampled.fuse_by(images, choice), None
