# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How near an image comes to a known all-in-focus truth."""
import os

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt
from skimage.metrics import peak_signal_noise_ratio

from all_in_focus.rig import load_rig
from all_in_focus.stack import Stack

EDGE_REACH_PX = 8  # how far from a depth edge a pixel still counts as near it


def near_depth_edges(depth_mm, step_dioptres):
    """Mask (H x W, bool) of the pixels within EDGE_REACH_PX of a depth edge.

    depth_mm: H x W, true depth, > 0. step_dioptres: smallest jump between neighbours, 1/m, that is an edge.
    """
    dioptres = 1000.0 / depth_mm.astype(float)
    edge = np.zeros(depth_mm.shape, bool)
    edge[:, 1:] |= np.abs(np.diff(dioptres, axis=1)) > step_dioptres
    edge[1:, :] |= np.abs(np.diff(dioptres, axis=0)) > step_dioptres
    return distance_transform_edt(~edge) <= EDGE_REACH_PX


def psnr(image, truth, mask=None):
    """Peak signal to noise ratio in dB of 8-bit images (H x W x 3), over mask (H x W, bool) or everywhere."""
    if image.shape != truth.shape:
        raise ValueError("images differ in size: %dx%d and %dx%d" % (image.shape[1::-1] + truth.shape[1::-1]))
    if mask is not None:
        image, truth = image[mask], truth[mask]
    if np.array_equal(image, truth):
        return float("inf")
    return peak_signal_noise_ratio(truth, image, data_range=255)


def _read(path, flags=cv2.IMREAD_COLOR):
    image = cv2.imread(path, flags)
    if image is None:
        raise ValueError("%s: no such file, or not an image" % path)
    return image


def psnr_table(scene, fused):
    """Lines of a table: PSNR of each frame of a scene folder (see make_scene), of the mean and best of them, and of
    each fused image, over the whole image and near depth edges."""
    truth = _read(os.path.join(scene, "truth.png"))
    optics = load_rig(os.path.join(scene, "rig")).optics
    # Half the span of one depth of field, 1/H, is a jump that blurs visibly.
    step = 500 * optics.aperture * optics.circle_of_confusion_mm / optics.focal_length_mm ** 2
    edges = near_depth_edges(_read(os.path.join(scene, "truth_depth.png"), cv2.IMREAD_UNCHANGED), step)
    stack = Stack(os.path.join(scene, "stack"))
    row = "%-34s %8.2f %12.2f"
    singles = [(psnr(frame, truth), psnr(frame, truth, edges)) for frame in stack]
    lines = ["%-34s %8s %12s" % ("PSNR against the truth, dB", "image", "depth edges")]
    lines += [row % ((name,) + values) for name, values in zip(stack.names, singles)]
    lines.append(row % (("best single frame",) + max(singles)))
    for path in fused:
        image = _read(path)
        lines.append(row % (os.path.join(*path.split(os.sep)[-2:]), psnr(image, truth), psnr(image, truth, edges)))
    return lines
