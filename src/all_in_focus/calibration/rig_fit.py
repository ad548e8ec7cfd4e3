# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Both cameras and their relative pose from pairs of views, bad views left out and named."""
from dataclasses import dataclass, field
from typing import Dict, List, Tuple

import cv2
import numpy as np

from all_in_focus.calibration import CalibrationError
from all_in_focus.calibration.camera_fit import CameraFit, distortion_flags, fit_camera, known_camera, limit
from all_in_focus.calibration.consensus import OTHERWISE, agree

MIN_PAIRS = 5
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-7)
GROUPS = 8  # of views, each of which is left out once to see how much the result depends on it
DEPTHS = (0.8, 1.5, 4.0)  # m: where the mapping is judged
MOVED = "the cameras' relative pose is another: was the board moved between the two pictures?"


@dataclass
class RigFit:
    """X_color = R X_depth + t (m). errors: pixels RMS of each camera by pair; left_out: pair -> reason.

    spread: standard deviations of t (m, 3), of the turn (rad) and of where a depth pixel lies in the colour picture
    (pixels, RMS over the picture and DEPTHS).
    """
    depth: CameraFit
    color: CameraFit
    R: np.ndarray
    t: np.ndarray
    errors: Dict[str, Tuple[float, float]]
    left_out: Dict[str, str]
    jointly: bool
    spread: tuple = (None, None, None)
    missing: Dict[str, str] = field(default_factory=dict)  # pair -> which picture does not show the board, and why

    @property
    def rms(self):
        return float(np.sqrt(np.mean(np.square(list(self.errors.values())))))


def fit_rig(board, pairs: List, sizes, known=(None, None), radial=2):
    """RigFit of pairs.Pair; sizes: ((width, height) of the depth, of the colour camera); known: rig.Camera or None."""
    missing = _missing(pairs)
    fits = [_fit(name, board, pairs, size, camera, radial)
            for name, size, camera in zip(("depth", "color"), sizes, known)]
    both = [pair for pair in pairs if pair.depth is not None and pair.color is not None
            and not any(pair.name in fit.left_out for fit in fits)]
    if len(both) < MIN_PAIRS:
        raise CalibrationError("%d usable pairs show the board to both cameras, at least %d are needed, 20 are good"
                               % (len(both), MIN_PAIRS))
    order, off = agree(board, both, *fits, sizes[1][0])
    left_out = _disagreeing(off, sizes[1][0])
    # Refined together, both cameras' intrinsics fit each other: where tried, a depth pixel then maps three times more
    # precisely than with each camera's own. With few pairs among many single views they would lose.
    jointly = known == (None, None) and all(2 * len(both) >= len(fit.errors) for fit in fits)
    solver = _Solver(board, {pair.name: (pair.depth, order[pair.name]) for pair in both}, fits, sizes[0],
                     distortion_flags(radial) if jointly else None)
    while True:
        kept = [pair.name for pair in both if pair.name not in left_out]
        if 2 * len(kept) < len(both) or len(kept) < MIN_PAIRS:
            raise CalibrationError("the cameras' relative pose differs from pair to pair (only %d of %d agree): were "
                                   "the cameras or the board moved, or is one camera's picture mirrored?"
                                   % (len(kept), len(both)))
        solution = solver.solve(kept)
        total = {name: float(np.hypot(*error)) for name, error in solution.errors.items()}
        worst = max(total, key=total.get)
        if total[worst] <= limit(total.values()):
            break
        left_out[worst] = "%.2f px in the pair, far above the others: %s" % (total[worst], MOVED)
    for fit, K, D in zip(fits, solution.K, solution.D):
        fit.K, fit.D = K, D
    return RigFit(*fits, solution.R, solution.t, solution.errors, left_out, jointly,
                  _spread(solver, kept, solution, sizes), missing)


def _missing(pairs):
    words = {(True, True): "no board in either picture", (True, False): "no board in the depth picture",
             (False, True): "no board in the color picture"}
    found = {pair.name: pair.unreadable or words.get((pair.depth is None, pair.color is None)) for pair in pairs}
    return {name: word for name, word in found.items() if word}


def _fit(name, board, pairs, size, camera, radial):
    corners = {pair.name: getattr(pair, name) for pair in pairs if getattr(pair, name) is not None}
    if camera is None:
        return fit_camera(name, board, corners, size, radial)
    if (camera.width, camera.height) != tuple(size):
        raise CalibrationError("the %s camera's known calibration is for %dx%d pixels, its pictures have %dx%d"
                               % (name, camera.width, camera.height, *size))
    return known_camera(name, board, corners, camera)


def _disagreeing(off, width):
    """Left out at first sight: the poses of single views are not precise, so only what is grossly off."""
    bound = min(max(0.01 * width, 6 * float(np.median(list(off.values())))), OTHERWISE * width)
    return {name: "%.0f px beside where the others put it: %s" % (pixels, MOVED)
            for name, pixels in off.items() if pixels > bound}


@dataclass
class _Solution:
    K: list
    D: list
    R: np.ndarray
    t: np.ndarray
    errors: Dict[str, Tuple[float, float]]


class _Solver:
    """cv2.stereoCalibrate on any subset of the pairs; flags None: intrinsics stay as they are."""

    def __init__(self, board, corners, fits, size, flags):
        self._board, self._corners, self._fits, self._size = board, corners, fits, size
        self._fixed = flags is None
        self._flags = cv2.CALIB_FIX_INTRINSIC if self._fixed else flags | cv2.CALIB_USE_INTRINSIC_GUESS
        if any(len(fit.D) > 5 for fit in fits):  # only known cameras have more
            self._flags |= cv2.CALIB_RATIONAL_MODEL

    def solve(self, names):
        corners = [[np.ascontiguousarray(self._corners[name][camera], np.float32) for name in names]
                   for camera in (0, 1)]
        start = [array.copy() for fit in self._fits for array in (fit.K, fit.D)]
        result = cv2.stereoCalibrateExtended([self._board.points] * len(names), *corners, *start, self._size,
                                             np.eye(3), np.zeros((3, 1)), flags=self._flags, criteria=CRITERIA)
        _, K1, D1, K2, D2, R, t = result[:7]
        # Of the tuple's end only the last is the same in all versions of OpenCV.
        errors = {name: tuple(map(float, error)) for name, error in zip(names, result[-1])}
        K, D = [K1, K2], [np.ravel(D1), np.ravel(D2)]
        if self._fixed:
            K, D = [fit.K for fit in self._fits], [fit.D for fit in self._fits]
        return _Solution(K, D, R, t.ravel(), errors)


def map_points(K, D, R, t, size):
    """Where depth pixels, a grid at DEPTHS, lie in the colour picture, N x 2; K, D: of both cameras."""
    u, v = np.meshgrid(np.linspace(0.05, 0.95, 7) * size[0], np.linspace(0.05, 0.95, 5) * size[1])
    rays = cv2.undistortPoints(np.stack([u, v], axis=-1).reshape(-1, 1, 2), K[0], D[0])[:, 0]
    rays = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    points = np.concatenate([rays * z for z in DEPTHS])
    return cv2.projectPoints(points, cv2.Rodrigues(R)[0], t, K[1], D[1])[0][:, 0]


def _spread(solver, names, whole, sizes):
    """Standard deviations by the jackknife: what changes when one group of views after the other is left out."""
    groups = min(GROUPS, len(names))
    found, seen = [], map_points(whole.K, whole.D, whole.R, whole.t, sizes[0])
    inside = ((seen >= 0) & (seen < sizes[1])).all(axis=1)
    for group in range(groups):
        part = solver.solve([name for number, name in enumerate(names) if number % groups != group])
        turn = cv2.Rodrigues(part.R @ whole.R.T)[0].ravel()
        mapped = map_points(part.K, part.D, part.R, part.t, sizes[0])[inside]
        found.append(np.concatenate([part.t, turn, mapped.ravel()]))
    deviations = np.std(found, axis=0) * np.sqrt(groups - 1)
    mapping = float(np.sqrt(np.mean(deviations[6:] ** 2) * 2)) if inside.any() else None
    return deviations[:3], float(np.linalg.norm(deviations[3:6])), mapping
