# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the metrics share: checks, stretching, windows, a memory of what was computed from the sources."""
import functools
import hashlib
import threading
from collections import OrderedDict

import cv2
import numpy as np

from all_in_focus.files.stack import size_text

MEMORY_BYTES = 512 << 20  # of cached results
MIN_SIZE = 7  # pixels, the window of Q_Y
GRAY_OF_BGR = (0.114021, 0.587043, 0.298936)  # as Matlab's rgb2gray; cvtColor's differ by 1 in some pixels


def to_gray(image):
    """H x W uint8 of H x W (as it is) or H x W x 3 (BGR) uint8; ValueError for anything else."""
    if image.dtype != np.uint8 or not (image.ndim == 2 or image.ndim == 3 and image.shape[2] == 3):
        raise ValueError(f"expected an 8-bit image with one or three channels, not {image.dtype} of shape {image.shape}")
    return image if image.ndim == 2 else np.floor(image @ np.array(GRAY_OF_BGR) + 0.5).astype(np.uint8)


def check_same_size(image, other):
    """ValueError for images of different sizes."""
    if image.shape[:2] != other.shape[:2]:
        raise ValueError(f"images differ in size: {size_text(image)} and {size_text(other)}")


def stretched(gray):
    """Gray values stretched to 0..255 and rounded, float64; a flat image as it is."""
    gray = np.float64(gray)
    low, high = gray.min(), gray.max()
    return gray if low == high else np.floor((gray - low) / (high - low) * 255 + 0.5)


def windowed(image, window):
    """Correlate H x W float64 with the separable window, zeros outside, same size."""
    return cv2.sepFilter2D(image, cv2.CV_64F, window, window, borderType=cv2.BORDER_CONSTANT)


class Local:
    """Mean and variance of values (H x W) in a Gaussian window around each pixel, zeros outside."""

    def __init__(self, values, size, sigma):
        self.values, self._window = np.float64(values), cv2.getGaussianKernel(size, sigma)
        self.mean = windowed(self.values, self._window)
        self.variance = self.covariance(self)

    def covariance(self, other):
        return windowed(self.values * other.values, self._window) - self.mean * other.mean


def ratio(part, whole, otherwise=0.0):
    """part / whole; `otherwise` where whole is 0."""
    return np.divide(part, whole, out=np.full(np.shape(whole), float(otherwise)), where=whole != 0)


# --- a cache of results that depend on the sources alone --------------------------------------------------------------

_remembered = OrderedDict()  # (function, digests of its images) -> (result, its bytes), the latest use last
_lock = threading.Lock()


def remembered(function):
    """A function of images (H x W uint8) that keeps its latest results, up to MEMORY_BYTES over all functions: many fused
    images are measured by the same sources. Callers must not change the arrays that it returns."""
    @functools.wraps(function)
    def ask(*images):
        key = (function, *((image.shape, hashlib.sha1(np.ascontiguousarray(image)).digest()) for image in images))
        with _lock:
            if key in _remembered:
                _remembered.move_to_end(key)
                return _remembered[key][0]
        result = function(*images)
        with _lock:
            _remembered[key] = (result, _bytes_of(result))
            while sum(size for _, size in _remembered.values()) > MEMORY_BYTES:
                _remembered.popitem(last=False)
        return result
    return ask


def _bytes_of(value):
    if isinstance(value, np.ndarray):
        return value.nbytes
    parts = value if isinstance(value, (list, tuple)) else getattr(value, "__dict__", {}).values()
    return sum(map(_bytes_of, parts))
