# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How good a fused image is, judged by its sources alone: the six metrics of Liu et al. ("Objective assessment of
multiresolution image fusion algorithms for context enhancement in night vision", PAMI 34(1), 2012) that the evaluation
of depth-assisted fusion used. They reward copying: an unfused source beats every method in Q_MI and Q_NCIE.

Each is metric(sources, fused) -> float. sources: list of at least two H x W uint8 gray images (see `to_gray`), fused:
H x W uint8, at least 7 x 7. NaN where nothing in the images is measurable. With two sources the values are those that
were published. The docstring of each metric says how it is generalised to more sources.
"""
from all_in_focus.files.stack import size_text
from all_in_focus_lab.metrics.contrast import q_cb
from all_in_focus_lab.metrics.gradient import q_g
from all_in_focus_lab.metrics.images import MIN_SIZE, check_same_size, to_gray
from all_in_focus_lab.metrics.information import q_mi, q_ncie
from all_in_focus_lab.metrics.phase import q_p
from all_in_focus_lab.metrics.structure import q_y

# With a truth; the last one only where its depth is known too.
TRUTH_MEASURES = ("PSNR", "SSIM", "PSNR_edges")
# Of kept_contrast.py; they need no truth.
CONTRAST_MEASURES = ("kept_contrast", "kept_contrast_least", "roughness")

METRICS = {"Q_MI": q_mi, "Q_NCIE": q_ncie, "Q_G": q_g, "Q_P": q_p, "Q_Y": q_y, "Q_CB": q_cb}


def evaluate(sources, fused, names=tuple(METRICS)):
    """Name -> value of metrics. Images: H x W (gray) or H x W x 3 (BGR) uint8; ValueError where they do not fit."""
    images = [to_gray(image) for image in (*sources, fused)]
    if len(images) < 3:
        raise ValueError("at least two sources are needed")
    for image in images[:-1]:
        check_same_size(image, images[-1])
    if min(images[-1].shape) < MIN_SIZE:
        raise ValueError(f"images of {size_text(images[-1])} pixels are too small: at least {MIN_SIZE}x{MIN_SIZE} are needed")
    return {name: METRICS[name](images[:-1], images[-1]) for name in names}
