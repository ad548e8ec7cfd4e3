# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Li, Kang, Hu, "Image fusion with guided filtering", IEEE Transactions on Image Processing 22(7), 2013.

Every image is split into a base (local mean) and a detail layer. Where an image is the most salient its weight is 1,
else 0; guided by the image itself these maps are smoothed, widely for the base, narrowly for the detail.
"""
import cv2
import numpy as np

from all_in_focus_lab.baselines.common import mixed, to_8_bit

BASE_SIZE = 31                         # of the mean filter, pixels
SALIENCY_SIZE, SALIENCY_SIGMA = 11, 5  # of the Gaussian that spreads the Laplacian, pixels
BASE_RADIUS, BASE_EPS = 45, 0.3        # of the guided filter, for values 0..1
DETAIL_RADIUS, DETAIL_EPS = 7, 1e-6
WEIGHT_FLOOR = 1e-9                    # so that weights have a sum wherever the filter undershoots


def saliency(gray):
    """Smoothed magnitude of the Laplacian; gray: H x W, 0..1."""
    laplacian = np.abs(cv2.Laplacian(gray, -1, ksize=1, borderType=cv2.BORDER_REPLICATE))
    return cv2.GaussianBlur(laplacian, (SALIENCY_SIZE,) * 2, SALIENCY_SIGMA, borderType=cv2.BORDER_REPLICATE)


def guided_filter(guide, image, radius, eps):
    """He et al.'s guided filter of an H x W image by an H x W guide; windows are cut at the border."""
    # The variance of a flat guide is a small difference: float32 would not do.
    guide, image = guide.astype(np.float64), image.astype(np.float64)

    def mean(values):
        return cv2.boxFilter(values, -1, (2 * radius + 1,) * 2, normalize=False, borderType=cv2.BORDER_CONSTANT) / area

    area = 1.0
    area = mean(np.ones(guide.shape))
    mean_guide, mean_image = mean(guide), mean(image)
    slope = (mean(guide * image) - mean_guide * mean_image) / (mean(guide * guide) - mean_guide ** 2 + eps)
    return mean(slope) * guide + mean(mean_image - slope * mean_guide)


def fuse(images, same=False):
    """See all_in_focus_lab.baselines; the weights are those of the detail layer. same: use them for the base layer too."""
    images = [np.float32(image) / 255 for image in images]
    grays = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in images]
    index = np.argmax([saliency(gray) for gray in grays], axis=0)

    def weights(radius, eps):
        smooth = [guided_filter(gray, index == number, radius, eps) for number, gray in enumerate(grays)]
        smooth = np.maximum(smooth, WEIGHT_FLOOR)
        return np.float32(smooth / smooth.sum(axis=0))

    detail = weights(DETAIL_RADIUS, DETAIL_EPS)
    if same:
        return mixed([255 * image for image in images], detail), detail
    fused = 0
    for image, base_weight, detail_weight in zip(images, weights(BASE_RADIUS, BASE_EPS), detail):
        base = cv2.blur(image, (BASE_SIZE,) * 2)
        fused = fused + base_weight[..., None] * base + detail_weight[..., None] * (image - base)
    return to_8_bit(255 * fused), detail
