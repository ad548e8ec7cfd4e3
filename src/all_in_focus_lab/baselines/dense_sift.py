# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Liu, Liu, Wang, "Multi-focus image fusion with dense SIFT", Information Fusion 23, 2015.

Activity is the sum of a pixel's SIFT descriptor before it is normalised. Blocks slide over the image; a pixel that lies
only in blocks won by one image is taken from it, the others from the image of greater spatial frequency. The paper
also looks for the matching pixel of the other image there, for images that are not aligned: left out.
"""
import cv2
import numpy as np
from skimage.morphology import remove_small_objects

from all_in_focus_lab.baselines.common import grays_of, mixed, one_hot, spatial_frequency

GRADIENT_SIGMA = 1         # pixels
DIRECTIONS, SHARPNESS = 8, 9  # of the orientation histogram; exponent of the cosine that shares out a gradient
SCALE, CELLS = 48, 4       # width of a descriptor, pixels; its cells along an axis
BLOCK = 8                  # pixels
SMALLEST = 1 / 40          # of the image; smaller regions are undecided
FREQUENCY_BLOCK = 8        # pixels


def gradient(gray):
    """Derivatives of a Gaussian, zeros outside."""
    x = np.arange(-2, 3)
    bell = np.exp(-x ** 2 / (2 * GRADIENT_SIGMA ** 2))
    for kernels in ((np.gradient(bell), bell), (bell, np.gradient(bell))):
        yield cv2.sepFilter2D(gray, cv2.CV_64F, *kernels, borderType=cv2.BORDER_CONSTANT)


def activity(gray):
    """Sum of the dense SIFT descriptor of every pixel; gray: H x W. Brightness is relative to the brightest pixel."""
    dx, dy = gradient(gray / max(gray.max(), 1))
    magnitude, angle = np.hypot(dx, dy), np.arctan2(dy, dx)
    total = sum(np.maximum(np.cos(angle - 2 * np.pi * k / DIRECTIONS), 0) ** SHARPNESS for k in range(DIRECTIONS))
    cell = SCALE / CELLS
    places = np.arange(SCALE) + 0.5
    tent = sum(np.maximum(0, 1 - np.abs(places - (k + 0.5) * cell) / cell) for k in range(CELLS))
    return cv2.sepFilter2D(magnitude * total, cv2.CV_64F, tent, tent, borderType=cv2.BORDER_CONSTANT)


def block_sums(image, size):
    """Of every size x size block inside the image."""
    total = np.pad(image, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    return total[size:, size:] - total[:-size, size:] - total[size:, :-size] + total[:-size, :-size]


def unanimous(wins):
    """Pixels of which every block is won; wins: bool, one per block."""
    return cv2.erode(np.uint8(np.pad(wins, BLOCK - 1, mode="constant", constant_values=True)),
                     np.ones((BLOCK, BLOCK)), anchor=(0, 0))[:1 - BLOCK, :1 - BLOCK] > 0


def fuse(images):
    """See all_in_focus_lab.baselines; the weights are 0 or 1. N images compete for every block at once."""
    grays = grays_of(images)
    if min(grays[0].shape) < BLOCK:
        raise ValueError(f"dsift needs images of at least {BLOCK}x{BLOCK} pixels")
    winner = np.argmax([block_sums(activity(gray), BLOCK) for gray in grays], axis=0)
    index = np.argmax([spatial_frequency(gray, FREQUENCY_BLOCK) for gray in grays], axis=0)
    for number in range(len(images)):
        index[remove_small_objects(unanimous(winner == number), int(SMALLEST * index.size))] = number
    weights = one_hot(index, len(images))
    return mixed(images, weights), weights
