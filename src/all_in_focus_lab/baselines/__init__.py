# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Other ways to fuse a focus bracket, to compare with; none knows depth.

Each is fuse(images) -> (fused, weights): images: non-empty list of N images of one size, H x W x 3 uint8 (BGR); fused:
H x W x 3 uint8; weights: N x H x W float32, sum 1, how much each image has at a pixel, None where the method
has none. Methods that decide on gray images take the same decision for all three colours.

Written from the papers; the steps and constants of im are those of its authors' program. What the papers leave open
(levels, thresholds, scaling) was chosen by comparison with published results on two pairs of photographs;
test_baselines.py tells how near each method comes to them.
"""
from functools import partial

from all_in_focus_lab.baselines import (contourlet, convolutional, dense_sift, enfuse, guided_filtering, laplacian_maximum,
                                        matting, pulse_coupled, wavelet)

BASELINES = {
    "dwt": wavelet.fuse,
    "nsct": contourlet.fuse,
    "im": matting.fuse,
    "gf": guided_filtering.fuse,
    "gf-same": partial(guided_filtering.fuse, same=True),
    "nsct-pcnn": pulse_coupled.fuse,
    "dsift": dense_sift.fuse,
    "dcnn": convolutional.fuse,
    "laplacian": laplacian_maximum.fuse,
    "enfuse": enfuse.fuse,
}
