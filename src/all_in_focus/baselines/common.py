# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the methods share: gray images, mixing, one-hot weights."""
import numpy as np

from all_in_focus.metrics import to_gray


def grays_of(images):
    """H x W float64, 0..255, of each H x W x 3 uint8 image (BGR)."""
    return [np.float64(to_gray(image)) for image in images]


def one_hot(index, count):
    """Weights, count x H x W float32, of an index image."""
    return np.float32(np.arange(count)[:, None, None] == index)


def to_8_bit(image):
    """Rounded half up and cut to 0..255."""
    return np.uint8(np.clip(np.floor(image + 0.5), 0, 255))


def mixed(images, weights):
    """Sum of the images, each times its weights (H x W), as uint8."""
    return to_8_bit(sum(weight[..., None] * image for image, weight in zip(images, weights)))


def choose(coefficients, index):
    """From each of N equal arrays (H x W or H x W x C) the elements where index (H x W) is its number."""
    chosen = coefficients[0].copy()
    for number, values in enumerate(coefficients[1:], 1):
        chosen[index == number] = values[index == number]
    return chosen
