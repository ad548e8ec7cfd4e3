# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Metric of perceived contrast: Q_CB."""
import numpy as np

from all_in_focus_lab.metrics.images import ratio, remembered, stretched, windowed

EYE_WIDE, EYE_NARROW, EYE_NARROW_SHARE = 15.3870, 1.3456, 0.7622  # difference of Gaussians over the spatial frequency
FREQUENCY_UNIT = 30                                              # pixels for one unit of it
REACH, SIGMAS = 15, (2, 4)                                       # pixels, of the two Gaussians whose ratio is contrast
MASKING = 1e-4


def sensitivity(shape):
    """Contrast sensitivity of the eye, rows x columns in the order of the FFT."""
    y, x = (2 * size * np.fft.fftfreq(size) / FREQUENCY_UNIT for size in shape)
    squared = y[:, None] ** 2 + x ** 2
    return np.exp(-squared / EYE_WIDE ** 2) - EYE_NARROW_SHARE * np.exp(-squared / EYE_NARROW ** 2)


def masked_contrast(gray, eye):
    """Contrast after masking, >= 0, H x W."""
    x = np.arange(-REACH, REACH + 1)
    seen = np.fft.ifft2(np.fft.fft2(stretched(gray)) * eye).real
    narrow, wide = (windowed(seen, np.exp(-x ** 2 / (2 * sigma ** 2)) / (np.sqrt(2 * np.pi) * sigma))
                    for sigma in SIGMAS)
    contrast = np.abs(ratio(narrow, wide, 1) - 1)
    return contrast ** 3 / (contrast ** 2 + MASKING)


@remembered
def _contrasts_and_shares(*sources):
    """N x H x W each: contrast of the sources, and how much each counts."""
    eye = sensitivity(sources[0].shape)
    contrasts = np.array([masked_contrast(source, eye) for source in sources])
    weights = contrasts ** 2
    return contrasts, ratio(weights, np.broadcast_to(weights.sum(axis=0), weights.shape), 1 / len(sources))


def q_cb(sources, fused):
    """Chen, Blum, "A new automated quality assessment algorithm for image fusion", Image and Vision Computing 27(10),
    2009. Arguments: see the package. Range 0..1.

    Ratio of the contrast in each source and in the fused image, weighted by the squared contrast of the source; more
    sources: more terms in the weighted mean.
    """
    contrasts, share = _contrasts_and_shares(*sources)
    target = masked_contrast(fused, sensitivity(fused.shape))
    preserved = ratio(np.minimum(contrasts, target), np.maximum(contrasts, target), 1)
    return float((share * preserved).sum(axis=0).mean())
