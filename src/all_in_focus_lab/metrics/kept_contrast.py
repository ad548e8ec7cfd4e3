# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How good a fused image is where no truth is known: how much contrast of the sharpest frames it keeps, at every scale,
and how rough the map of winners is."""
import cv2
import numpy as np

from all_in_focus.imaging import NO_FRAME
from all_in_focus_lab.metrics.images import check_same_size, remembered, to_gray

TILE = 64          # pixels of the full picture
BANDS = 6          # of the Laplacian pyramid; a tile of the last one is 2 x 2 pixels
SMALLEST = 24      # pixels: the short side of the smallest level
QUIET_PERCENT = 5  # of the tiles show noise alone, in their quietest frame


def band_energies(gray):
    """Mean square of each band of the Laplacian pyramid in each tile; list, finest band first. gray: H x W uint8."""
    level, energies = np.float32(gray), []
    for band in range(BANDS):
        coarser = cv2.pyrDown(level)
        squares = np.square(level - cv2.pyrUp(coarser, dstsize=level.shape[::-1]), dtype=np.float64)
        rows, columns = (np.arange(0, size, TILE >> band) for size in level.shape)
        sums = np.add.reduceat(np.add.reduceat(squares, rows, axis=0), columns, axis=1)
        areas = np.outer(*(np.diff(np.append(starts, size)) for starts, size in zip((rows, columns), level.shape)))
        energies.append(sums / areas)
        level = coarser
        if min(level.shape) < SMALLEST:
            break
    return energies


_frame_energies = remembered(band_energies)


def kept_contrast(frames, fused):
    """Share (0..1) of the contrast that some frame shows which the fused image keeps, for each band of the Laplacian
    pyramid, finest first; NaN where no frame shows any.

    frames: iterable of images, read once; all: H x W or H x W x 3 (BGR) uint8, of one size. The contrast of a tile is
    the root of its energy above the noise of the band; what the fused image shows beyond the best frame does not count.
    """
    energies, shares = [], []
    for frame in frames:
        check_same_size(frame, fused)
        energies.append(_frame_energies(to_gray(frame)))
    if not energies:
        raise ValueError("at least one frame is needed")
    for of_frames, kept in zip(zip(*energies), band_energies(to_gray(fused))):
        shown, noise = np.max(of_frames, axis=0), np.percentile(np.min(of_frames, axis=0), QUIET_PERCENT)
        shown, kept = (np.sqrt(np.maximum(energy - noise, 0)) for energy in (shown, np.minimum(kept, shown)))
        shares.append(float(kept.sum() / shown.sum()) if shown.any() else float("nan"))
    return shares


def roughness(winners):
    """Share (0..1) of the pairs of neighbours that come from different frames; winners: H x W, number of the frame with
    the most weight, NO_FRAME = none: such pairs do not count. NaN where there are no pairs."""
    pairs = [(winners[:, 1:], winners[:, :-1]), (winners[1:], winners[:-1])]
    known = [(one != NO_FRAME) & (other != NO_FRAME) for one, other in pairs]
    count = sum(mask.sum() for mask in known)
    different = sum((mask & (one != other)).sum() for mask, (one, other) in zip(known, pairs))
    return float(different / count) if count else float("nan")
