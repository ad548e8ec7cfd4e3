# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Other ways to fuse a focus bracket, to compare with; none knows depth.

Each is fuse(images) -> (fused, index): images: non-empty list of H x W x 3 uint8 (BGR) of one size; fused: the same;
index: H x W uint16, which image has most weight at a pixel, None where the method does not tell.
"""
from all_in_focus.baselines import enfuse, guided_filtering, laplacian_maximum

BASELINES = {
    "gf": guided_filtering.fuse,
    "laplacian": laplacian_maximum.fuse,
    "enfuse": enfuse.fuse,
}
