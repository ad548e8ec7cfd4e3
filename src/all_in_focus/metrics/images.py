# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the metrics share: gray values, stretching, windows."""
import cv2
import numpy as np

GRAY_OF_BGR = (0.114021, 0.587043, 0.298936)  # as Matlab's rgb2gray; cvtColor's differ by 1 in some pixels
MIN_SIZE = 7                                  # pixels, the window of Q_Y


def to_gray(image):
    """H x W uint8 of H x W (as it is) or H x W x 3 (BGR) uint8; ValueError for anything else."""
    image = np.asarray(image)
    if image.dtype != np.uint8 or not (image.ndim == 2 or image.ndim == 3 and image.shape[2] == 3):
        raise ValueError("expected an 8-bit image with one or three channels, not %s of shape %s"
                         % (image.dtype, image.shape))
    return image if image.ndim == 2 else np.floor(image @ np.array(GRAY_OF_BGR) + 0.5).astype(np.uint8)


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
