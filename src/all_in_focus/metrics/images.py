# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the metrics share: stretching, windows."""
import cv2
import numpy as np


MIN_SIZE = 7  # pixels, the window of Q_Y


def stretched(gray):
    """Gray values stretched to 0..255 and rounded, float64; a flat image as it is."""
    gray = np.float64(gray)
    low, high = gray.min(), gray.max()
    return gray if low == high else np.floor((gray - low) / (high - low) * 255 + 0.5)


def gaussian(size, sigma):
    """One axis of a Gaussian window of size x size pixels (odd), sum 1."""
    x = np.arange(size) - size // 2
    window = np.exp(-x ** 2 / (2 * sigma ** 2))
    return window / window.sum()


def windowed(image, window):
    """Correlate H x W float64 with the separable window, zeros outside, same size."""
    return cv2.sepFilter2D(image, cv2.CV_64F, window, window, borderType=cv2.BORDER_CONSTANT)


def ratio(part, whole, otherwise=0.0):
    """part / whole; `otherwise` where whole is 0."""
    return np.divide(part, whole, out=np.full(np.shape(whole), float(otherwise)), where=whole != 0)
