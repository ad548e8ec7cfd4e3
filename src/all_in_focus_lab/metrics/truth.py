# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How near an image comes to a known all-in-focus truth."""
import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from all_in_focus.files.rig import load_rig
from all_in_focus.files.stack import Stack, read_depth, read_image
from all_in_focus_lab.metrics.images import check_same_size

EDGE_REACH_PX = 8  # how far from a depth edge a pixel still counts as near it


@dataclass
class Truth:
    """What a scene folder (see make_scene) should be fused to; image: H x W x 3 uint8 (BGR), edges: H x W bool, the
    pixels near depth edges; enlarge: the frames have enlarge x enlarge pixels for one of these, the middle one equal to it."""
    image: np.ndarray
    edges: np.ndarray
    enlarge: int = 1

    @classmethod
    def load(cls, scene):
        """ValueError where a file is missing or damaged. Of an enlarged scene the truth is that of the small one."""
        scene = Path(scene)
        return cls.of(read_image(scene / "truth.png"), read_depth(scene / "truth_depth.png"),
                      load_rig(scene / "rig").optics, enlargement(scene))

    @classmethod
    def of(cls, image, depth_mm, optics, enlarge=1):
        """image: H x W x 3, depth_mm: H x W, 0 = unknown, both as large as the frames; optics: rig.Optics of the lens. Without
        depth or optics (None) no pixel is near an edge."""
        image = centres(image, enlarge)
        if depth_mm is None or optics is None:
            return cls(image, np.zeros(image.shape[:2], bool), enlarge)
        # Half the span of one depth of field, 1/H, is a jump that blurs visibly.
        step = 500 * optics.aperture * optics.circle_of_confusion_mm / optics.focal_length_mm ** 2
        return cls(image, near_depth_edges(centres(depth_mm, enlarge), step), enlarge)

    def compared(self, fused):
        """The pixels of a fused image (BGR) that are compared with the truth: the middle one of each block."""
        return centres(fused, self.enlarge)


def enlargement(scene):
    """Factor by which make_scene enlarged the frames of a scene folder; 1 where it made none."""
    try:
        return int(json.loads(Path(scene, "scene.json").read_text(encoding="utf-8"))["enlarge"])
    except (OSError, ValueError, KeyError, TypeError):  # not made by make_scene
        return 1


def centres(image, factor):
    """Every factor-th pixel (odd) of each row and column, from the middle of the first block."""
    return np.ascontiguousarray(image[factor // 2::factor, factor // 2::factor])


def near_depth_edges(depth_mm, step_dioptres):
    """Mask (H x W, bool) of the pixels within EDGE_REACH_PX of a depth edge.

    depth_mm: H x W, true depth; 0 = unknown, which makes no edge. step_dioptres: smallest jump between neighbours, 1/m,
    that is an edge.
    """
    dioptres = 1000.0 / np.where(depth_mm > 0, depth_mm, np.nan)
    edge = np.zeros(depth_mm.shape, bool)
    edge[:, 1:] |= np.abs(np.diff(dioptres, axis=1)) > step_dioptres
    edge[1:, :] |= np.abs(np.diff(dioptres, axis=0)) > step_dioptres
    return distance_transform_edt(~edge) <= EDGE_REACH_PX if edge.any() else edge


def depth_errors(depth_mm, truth_mm, blur_px_mm):
    """(share of the pixels that are holes, or for which the depth predicts a blur radius more than 1 px off; root mean square
    error in 1/m of all pixels but the holes).

    depth_mm, truth_mm: H x W, 0 = unknown, which does not count in the truth; blur_px_mm: radius in px per difference in
    1/depth in 1/mm, see blur_per_inverse_depth().
    """
    known = truth_mm > 0
    off = 1 / np.maximum(depth_mm[known], 1).astype(float) - 1 / truth_mm[known].astype(float)
    there = depth_mm[known] > 0
    wrong = ~there | (np.abs(off) * blur_px_mm > 1)
    return float(wrong.mean()), float(1000 * np.sqrt(np.mean(off[there] ** 2))) if there.any() else math.nan


def blur_per_inverse_depth(optics, focal_px, focus_mm):
    """Radius of the blur disc in px per difference in 1/depth in 1/mm, where it is greatest: f^2 / (2 F pitch) u / (u - f)
    of the frame with the nearest focus.

    optics: rig.Optics; focal_px: f of the colour camera's matrix, as large as the frames; focus_mm: of the frames.
    """
    f, nearest = optics.focal_length_mm, min(focus_mm)
    return f * focal_px / (2 * optics.aperture) * nearest / (nearest - f)


def psnr(image, truth, mask=None):
    """Peak signal to noise ratio in dB of 8-bit images (H x W x 3), over mask (H x W, bool) or everywhere."""
    check_same_size(image, truth)
    if mask is not None:
        image, truth = image[mask], truth[mask]
    if np.array_equal(image, truth):
        return float("inf")
    return float(peak_signal_noise_ratio(truth, image, data_range=255))


def ssim(image, truth):
    """Structural similarity (Wang et al. 2004: Gaussian window of sigma 1.5) of 8-bit images, mean of the channels."""
    check_same_size(image, truth)
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": 255}
    return float(np.mean([structural_similarity(truth[..., channel], image[..., channel], **options)
                          for channel in range(3)]))


def psnr_table(scene, fused):
    """Lines of a table: PSNR of each frame of a scene folder (see make_scene), of the best of them, and of
    each fused image, over the whole image and near depth edges."""
    truth = Truth.load(scene)
    stack = Stack(Path(scene) / "stack")

    def scores(image):
        return psnr(image, truth.image), psnr(image, truth.image, truth.edges)

    rows = [(name, scores(frame)) for name, frame in zip(stack.names, stack)]
    rows.append(("best single frame", max(values for _, values in rows)))
    rows += [("/".join(Path(path).parts[-2:]), scores(read_image(path))) for path in fused]
    return [f"{'PSNR against the truth, dB':<34} {'image':>8} {'depth edges':>12}",
            *(f"{name:<34} {of_all:8.2f} {near_edges:12.2f}" for name, (of_all, near_edges) in rows)]
