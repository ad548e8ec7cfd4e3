# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every pixel from the image that is sharpest there, by the modified Laplacian (Nayar, Nakagawa 1994)."""
import cv2
import numpy as np

from all_in_focus_lab.baselines.common import choose, one_hot

WINDOW_SIGMA = 2.0  # pixels, of the Gaussian window in which sharpness is summed


def sharpness(image):
    """H x W, of an H x W x 3 uint8 image."""
    gray = np.float32(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
    kernel = np.float32([[-1, 2, -1]])
    laplacian = sum(np.abs(cv2.filter2D(gray, -1, along, borderType=cv2.BORDER_REPLICATE))
                    for along in (kernel, kernel.T))
    return cv2.GaussianBlur(laplacian, (0, 0), WINDOW_SIGMA)


def fuse(images):
    """See all_in_focus_lab.baselines; of equally sharp images the first."""
    index = np.argmax([sharpness(image) for image in images], axis=0)
    return choose(images, index), one_hot(index, len(images))
