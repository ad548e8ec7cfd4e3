# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Li, Kang, Hu, Yang, "Image matting for fusion of multi-focus images in dynamic scenes", Information Fusion 14, 2013.

Morphological top-hats tell where one image is clearly sharper; from these pixels matting finds the weights of all
others. The matting here is that of He, Sun, Tang, "Fast matting using large kernel matting Laplacian matrices", CVPR
2010: large windows make the conjugate gradients converge, in large flat regions too.
"""
from inspect import signature

import cv2
import numpy as np
from scipy.sparse.linalg import LinearOperator, cg
from skimage.morphology import remove_small_objects

from all_in_focus.baselines.common import grays_of, one_after_the_other

TOP_HAT_RADIUS = 4           # pixels
VOTE_SIZE, MAJORITY = 15, 0.6  # pixels; share of a window that must agree
SMALLEST = 1 / 400           # of the image; smaller regions are unknown
WINDOW_RADIUS, EPS = 6, 1e-4  # of the matting, pixels; for colours 0..1
GUESS_SIGMA = 20             # pixels
SMALL = 200                  # pixels; larger images begin with what is found at half their size
ITERATIONS, TOLERANCE = 100, 1e-3
RELATIVE = "rtol" if "rtol" in signature(cg).parameters else "tol"  # before SciPy 1.12


def focus(gray):
    """Small bright and dark details; gray: H x W."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * TOP_HAT_RADIUS + 1,) * 2)
    return np.maximum(*(cv2.morphologyEx(gray, kind, kernel) for kind in (cv2.MORPH_TOPHAT, cv2.MORPH_BLACKHAT)))


def certain(sharper):
    """Pixels, most of whose neighbours agree; sharper: H x W bool."""
    votes = cv2.blur(np.float32(sharper), (VOTE_SIZE, VOTE_SIZE))
    return remove_small_objects(votes > MAJORITY, int(SMALLEST * sharper.size))


class MattingLaplacian:
    """The matting Laplacian as a function of an H x W image: 0 for a matte that is linear in the colours of each window."""

    def __init__(self, image):
        """image: H x W x 3, 0..1."""
        self.colours = [np.ascontiguousarray(image[..., channel]) for channel in range(3)]
        self.count = self.box(np.ones(image.shape[:2], image.dtype))
        self.means = [self.box(colour) / self.count for colour in self.colours]
        covariance = np.empty(image.shape[:2] + (3, 3))  # float64, for the inverse
        for i in range(3):
            for j in range(3):
                mean = self.box(self.colours[i] * self.colours[j]) / self.count
                covariance[..., i, j] = mean - self.means[i] * self.means[j]
        inverse = np.linalg.inv(covariance + EPS * np.eye(3)).astype(image.dtype)
        self.inverse = np.ascontiguousarray(np.moveaxis(inverse, (2, 3), (0, 1)))

    @staticmethod
    def box(values):
        return cv2.boxFilter(values, -1, (2 * WINDOW_RADIUS + 1,) * 2, normalize=False, borderType=cv2.BORDER_CONSTANT)

    def __call__(self, matte):
        mean = self.box(matte) / self.count
        shared = [self.box(matte * colour) / self.count - mean * of for colour, of in zip(self.colours, self.means)]
        slopes = [sum(factor * of for factor, of in zip(row, shared)) for row in self.inverse]
        offset = mean - sum(slope * of for slope, of in zip(slopes, self.means))
        linear = sum(self.box(slope) * colour for slope, colour in zip(slopes, self.colours))
        return self.count * matte - linear - self.box(offset)


def guess(image, front, back):
    """A matte to begin with, H x W float32; see `matte`."""
    if min(front.shape) <= SMALL:
        near, any_near = (cv2.GaussianBlur(np.float64(mask), (0, 0), GUESS_SIGMA) + 1e-9
                          for mask in (front, front | back))
        return np.float32(near / any_near)
    half = [cv2.resize(of, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            for of in (image, np.float32(front), np.float32(back))]
    return cv2.resize(np.float32(matte(half[0], half[1] > 0.5, half[2] > 0.5)), front.shape[::-1])


def matte(image, front, back):
    """H x W, 0..1: 1 where front (bool), 0 where back, by colour elsewhere; image: H x W x 3 uint8."""
    if not (front.any() or back.any()):
        return np.full(front.shape, 0.5)
    known = front | back
    result = np.where(known, np.float32(front), guess(image, front, back))
    if not known.all():
        result[~known] += correction(MattingLaplacian(np.float32(image) / 255), result, ~known)
    return np.clip(result, 0, 1)


def correction(laplacian, result, unknown):
    """What to add to the unknown pixels (H x W bool) of a matte, so that the Laplacian of the whole is 0 there.

    Conjugate gradients, preconditioned by the number of windows around each pixel; they end when no pixel changes by
    TOLERANCE any more.
    """
    count, found = laplacian.count[unknown], np.zeros(np.count_nonzero(unknown), np.float32)

    def apply(values):
        image = np.zeros_like(result)
        image[unknown] = values
        return laplacian(image)[unknown]

    def watch(values):
        change = np.abs(values - found).max()
        found[:] = values
        if change < TOLERANCE:
            raise StopIteration

    matrix, inverse = (LinearOperator((found.size,) * 2, of, dtype=result.dtype) for of in (apply, lambda v: v / count))
    try:
        cg(matrix, -laplacian(result)[unknown], M=inverse, maxiter=ITERATIONS, callback=watch, atol=0, **{RELATIVE: 0})
    except StopIteration:
        pass
    return found


def _share(fused, image):
    one, other = (np.int16(focus(np.uint8(gray))) for gray in grays_of([fused, image]))
    return np.float32(matte(fused, certain(one > other), certain(other > one)))


def fuse(images):
    """See all_in_focus.baselines."""
    return one_after_the_other(images, _share)
