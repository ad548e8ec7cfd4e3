# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the views do not tell well enough: parts of the picture without a board, boards that are all tilted alike."""
import numpy as np

MARGIN = 0.2  # of the picture, along a side, that may stay without a corner
SIDES = ("left", "top", "right", "bottom")
TILT = 12.0  # degrees between two boards, at least: below that focal length and distance cannot be told apart
DEVIATION = 0.01  # of the focal length
FEW = 12  # views


def uncovered(corners, size):
    """[(side, share of the picture along it without a corner)] where that is too much; corners: N x 2, pixels."""
    low, high = corners.min(axis=0) / size, corners.max(axis=0) / size
    return [(side, share) for side, share in zip(SIDES, (low[0], low[1], 1 - high[0], 1 - high[1])) if share > MARGIN]


def tilt_range(normals):
    """Largest angle between two boards, degrees; normals: N x 3."""
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1)).max()))


def warnings(name, fit, corners, size, known):
    """Lines on one camera; fit: CameraFit; corners: by view; size: (width, height)."""
    used = [points for view, points in corners.items() if view in fit.errors]
    if not known and len(used) < FEW:
        yield "the %s camera has %d views of the board only, 20 are good" % (name, len(used))
    if used and not known:
        for side, share in uncovered(np.concatenate(used), size):
            yield ("no board in the %s %.0f %% of the %s picture: its distortion there is a guess"
                   % (side, 100 * share, name))
        widest = tilt_range(np.array(list(fit.tilts.values())))
        if widest < TILT:
            yield ("all boards have nearly the same tilt to the %s camera (%.0f degrees apart): its focal length is "
                   "poorly determined, tilt them by 30 degrees and more, each otherwise" % (name, widest))
    for term, value in (("fx", fit.K[0, 0]), ("fy", fit.K[1, 1])):
        share = fit.deviations.get(term, 0) / value
        if share > DEVIATION:
            yield "%s of the %s camera is known to %.1f %% only: more views, more tilt" % (term, name, 100 * share)
