# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Liu, Chen, Peng, Wang, "Multi-focus image fusion with a deep convolutional neural network", Information Fusion 36,
2017.

A network with two branches of the same weights tells which of two patches is the sharper; each pixel has the mean score
of the patches that it lies in. That is rounded, cleaned of small regions and smoothed along the edges of the picture.
The network is our own, much smaller than the paper's, and trained on other images: see training/train_dcnn.py.
"""
from pathlib import Path

import cv2
import numpy as np
from skimage.morphology import remove_small_holes, remove_small_objects

from all_in_focus_lab.baselines.common import grays_of, one_after_the_other
from all_in_focus_lab.baselines.guided_filtering import guided_filter

NETWORK = str(Path(__file__).with_name("dcnn.onnx"))
PATCH, STEP = 16, 2  # of the network, pixels
SMALLEST = 1 / 100   # of the image; smaller regions go to what surrounds them
RADIUS, EPS = 8, 0.1  # of the guided filter, pixels; for values 0..1


def patch_scores(one, other):
    """Of the patches that begin at every STEP-th pixel: 1 where `one` is sharper, 0: `other`. H x W float32, 0..1."""
    network = cv2.dnn.readNetFromONNX(NETWORK)
    for name, gray in (("one", one), ("other", other)):
        network.setInput(gray[None, None], name)
    return network.forward()[0, 0]


def focus_map(one, other):
    """Mean score of the patches around each pixel, H x W; one, other: H x W, 0..255."""
    height, width = one.shape
    before, behind = PATCH - STEP, PATCH - 1  # so that as many patches cover a pixel of the border as any other
    padded = [cv2.copyMakeBorder(np.float32(gray) / 255, before, behind, before, behind, cv2.BORDER_REFLECT)
              for gray in (one, other)]
    scores, window = patch_scores(*padded), PATCH // STEP
    means = cv2.blur(scores, (window, window), anchor=(0, 0))[:1 - window, :1 - window]
    return means.repeat(STEP, axis=0).repeat(STEP, axis=1)[:height, :width]


def decision(one, other):
    """H x W bool: take `one`?"""
    sharper, smallest = focus_map(one, other) > 0.5, int(SMALLEST * one.size)
    return remove_small_holes(remove_small_objects(sharper, smallest), smallest)


def _share(fused, image):
    one, other = grays_of([fused, image])
    first = decision(one, other)
    return guided_filter(np.where(first, one, other) / 255, first, RADIUS, EPS)


def fuse(images):
    """See all_in_focus_lab.baselines."""
    return one_after_the_other(images, _share)
