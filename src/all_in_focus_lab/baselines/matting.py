# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Li, Kang, Hu, Yang, "Image matting for fusion of multi-focus images in dynamic scenes", Information Fusion 14, 2013.

Morphological top-hats tell where an image is clearly the sharpest; from these pixels matting finds its share of all
others. The matting is that of Levin, Lischinski, Weiss, "A closed-form solution to natural image matting", PAMI 30(2),
2008: solved on a small image, then enlarged as a linear function of the colours of each window.

As in the authors' program, the share of the first of two images may leave 0..1, because it was enlarged. The share of the
second is the rest, limited to 0..1 and rounded to 8 bits. Where both do not sum to 1, the result is brighter or darker than
both images. With more images such errors would add up, so all shares are limited.
"""
import cv2
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from skimage.morphology import disk, thin

from all_in_focus_lab.metrics.images import to_gray
from all_in_focus_lab.baselines.common import mixed, one_after_the_other, to_8_bit

TOP_HAT = disk(2)
VOTE_SIZE = 8                # pixels; at least half of a window must agree
THINNING = 5                 # pixels
CERTAIN = 127                # gray levels; so much more detail decides at once
LEVEL_SIDES = (256, 512, 768, 1536, 3072, 6144)  # pixels; a larger image is halved once more. Up to 768 as published
SMALLEST_SIDE = 16           # pixels; a narrower image is not halved
EPS = 1e-7                   # of the matting, for colours 0..1
KNOWN_WEIGHT, LEAST_WEIGHT = 100, 1e-12  # the latter for pixels of images that are too small for a window
HALVING = np.array([1, 4, 6, 4, 1]) / 16


def focus(gray):
    """Small bright and dark details, H x W int16; gray: H x W uint8."""
    return np.int16(np.maximum(*(cv2.morphologyEx(gray, kind, TOP_HAT) for kind in (cv2.MORPH_TOPHAT, cv2.MORPH_BLACKHAT))))


def voted(mask):
    """Where at least half of the pixels in a window are True; mask: H x W bool."""
    middle = (VOTE_SIZE - 1) // 2
    votes = cv2.boxFilter(np.float32(mask), -1, (VOTE_SIZE,) * 2, anchor=(middle,) * 2, normalize=False,
                          borderType=cv2.BORDER_CONSTANT)
    return votes >= VOTE_SIZE ** 2 / 2


def certain(more):
    """Where an image surely has more detail; more: H x W, how much more it has than the other."""
    return voted(thin(voted(more > 0), THINNING)) | (more > CERTAIN)


def window_sums(values):
    """Sums over 3 x 3 pixels, (H - 2) x (W - 2) x ... ."""
    rows = values[:-2] + values[1:-1] + values[2:]
    return rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]


def laplacian(image):
    """The matting Laplacian of an H x W x 3 image, 0..1: a sparse matrix, 0 for a matte that is linear in the colours of
    each window."""
    pixels = np.arange(image.shape[0] * image.shape[1]).reshape(image.shape[:2])
    height, width = (max(side - 2, 0) for side in pixels.shape)
    windows = np.stack([pixels[y:y + height, x:x + width].ravel() for y in range(3) for x in range(3)], axis=1)
    colours = image.reshape(-1, 3)[windows]
    colours -= colours.mean(axis=1, keepdims=True)
    covariance = (np.swapaxes(colours, 1, 2) @ colours + EPS * np.eye(3)) / 9
    affinity = (1 + colours @ np.linalg.solve(covariance, np.swapaxes(colours, 1, 2))) / 9
    indices = np.repeat(windows, 9, axis=1).ravel(), np.tile(windows, 9).ravel()
    return sparse.csc_matrix(((np.eye(9) - affinity).ravel(), indices), (pixels.size,) * 2)


def solved(image, known, front):
    """The matte of an H x W x 3 image, 0..1; known, front: H x W, 0 or 1."""
    weight = KNOWN_WEIGHT * known.ravel()
    matrix = laplacian(image) + sparse.diags(weight + LEAST_WEIGHT, format="csc")
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0, options={"SymmetricMode": True})
    return factors.solve(weight * front.ravel()).reshape(known.shape)


def linear(matte, image):
    """Slopes and offset, H x W x 4, of the matte as a linear function of the colours in the window around each pixel."""
    mean, colours = window_sums(matte)[..., None] / 9, window_sums(image) / 9
    products = window_sums(image[..., None] * image[..., None, :]) / 9 - colours[..., None] * colours[..., None, :]
    shared = window_sums(matte[..., None] * image) / 9 - mean * colours
    slopes = np.linalg.solve(products + EPS / 9 * np.eye(3), shared[..., None])[..., 0]
    offset = mean - (slopes * colours).sum(axis=2, keepdims=True)
    return np.pad(np.concatenate([slopes, offset], axis=2), ((1, 1), (1, 1), (0, 0)), mode="edge")


def halved(image):
    return cv2.sepFilter2D(image, -1, HALVING, HALVING)[2:-2:2, 2:-2:2]


def doubled(values, shape):
    """What `halved` left of an image of this shape, interpolated for all of it."""
    padded = np.pad(values, ((1, 2), (1, 2), (0, 0)), mode="edge")
    sparse_values = np.zeros((2 * padded.shape[0], 2 * padded.shape[1], values.shape[2]))
    sparse_values[::2, ::2] = padded
    return cv2.sepFilter2D(sparse_values, -1, np.array([0.5, 1, 0.5]), np.array([0.5, 1, 0.5]))[:shape[0], :shape[1]]


def enlarged(image, known, front, levels):
    """The matte as found at an image halved `levels` times; 0.5 where nothing is known."""
    if levels == 0 or min(known.shape) < SMALLEST_SIDE:
        return np.clip(solved(image, known, front), 0, 1) if known.any() else np.full(known.shape, 0.5)
    half = halved(image)
    matte_of_half = enlarged(half, np.floor(halved(known) + 0.5), np.floor(halved(front) + 0.5), levels - 1)
    coefficients = doubled(linear(matte_of_half, half), known.shape)
    return coefficients[..., 3] + (coefficients[..., :3] * image).sum(axis=2)


def matte(image, front, back):
    """H x W, about 0..1: 1 where front (bool), 0 where back, by colour elsewhere; image: H x W x 3 uint8."""
    levels = sum(front.size > side ** 2 for side in LEVEL_SIDES)
    return enlarged(image / 255, (front | back).astype(np.float64), front.astype(np.float64), levels)


def _share(one, other):
    """How much `one` has, H x W, about 0..1."""
    more = focus(to_gray(one)) - focus(to_gray(other))
    front, back = certain(more), certain(-more)
    return matte(one, front & ~back, back & ~front)


def fuse(images):
    """See all_in_focus_lab.baselines; more than two images with shares that are limited to 0..1."""
    if len(images) != 2:
        return one_after_the_other(images, _share)
    share = _share(*images)
    limited = np.clip(share, 0, 1)
    return (mixed(images, [share, 1 - to_8_bit(255 * limited) / 255]), np.float32([limited, 1 - limited]))
