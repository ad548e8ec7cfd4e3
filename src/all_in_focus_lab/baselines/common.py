# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the methods share: gray images, mixing, one-hot weights, spatial frequency."""
import cv2
import numpy as np

from all_in_focus_lab.metrics.images import to_gray


def grays_of(images):
    """H x W float64, 0..255, of each H x W x 3 uint8 image (BGR)."""
    return [to_gray(image).astype(np.float64) for image in images]


def one_hot(index, count):
    """Weights, count x H x W float32, of an index image."""
    return np.float32(np.arange(count)[:, None, None] == index)


def to_8_bit(image):
    """Rounded half up and cut to 0..255."""
    return np.uint8(np.clip(np.floor(image + 0.5), 0, 255))


def mixed(images, weights):
    """Sum of the images, each times its weights (H x W), as uint8."""
    return to_8_bit(sum(weight[..., None] * image for image, weight in zip(images, weights)))


def one_after_the_other(images, share_of):
    """(fused, weights), see all_in_focus_lab.baselines, where each image is fused with what came before.

    share_of(one, other): how much `one` has, H x W, limited to 0..1 here.
    """
    fused, weights = images[0], np.ones((1,) + images[0].shape[:2], np.float32)
    for image in images[1:]:
        share = np.float32(np.clip(share_of(fused, image), 0, 1))
        weights = np.concatenate([weights * share, 1 - share[None]])
        fused = mixed([fused, image], [share, 1 - share])
    return mixed(images, weights), weights


def spatial_frequency(gray, size):
    """Mean over size x size pixels of the squared differences to the neighbours above and to the left; H x W."""
    squares = np.zeros_like(gray)
    squares[:, 1:] += np.diff(gray, axis=1) ** 2
    squares[1:] += np.diff(gray, axis=0) ** 2
    return cv2.blur(squares, (size, size))


def choose(coefficients, index):
    """From each of N equal arrays (H x W or H x W x C) the elements where index (H x W) is its number."""
    chosen = coefficients[0].copy()
    for number, values in enumerate(coefficients[1:], 1):
        chosen[index == number] = values[index == number]
    return chosen
