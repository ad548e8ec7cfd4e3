# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fits both cameras and their relative pose to pairs of views of a board; names bad views and leaves them out.

First each camera alone (fit_camera), then the relative pose on which most views agree (agree), then all together.
"""
from dataclasses import dataclass
from functools import partial
from typing import Dict, List, Tuple

import cv2
import numpy as np

from all_in_focus.calibration.board import CAMERAS

MIN_VIEWS = MIN_PAIRS = 5
CAMERA_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-8)
RIG_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-7)
KNOWN = (cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_FOCAL_LENGTH | cv2.CALIB_FIX_PRINCIPAL_POINT
         | cv2.CALIB_FIX_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_FIX_K4
         | cv2.CALIB_FIX_K5 | cv2.CALIB_FIX_K6)
TERMS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
GROUPS = 8  # of views; each is left out once to see how much the result depends on it
DEPTHS = (0.8, 1.5, 4.0)  # m: where the mapping is evaluated
ROBUST_COST_CAP = 0.04  # of the picture's width: larger distances from the common pose all cost the same
MOVED = "the cameras' relative pose is another: was the board moved between the two pictures?"


@dataclass
class CameraFit:
    """K 3x3, D 5. errors: RMS in pixels by view; left_out: reason by view; deviations: standard deviations by term, none of a
    known camera."""
    K: np.ndarray
    D: np.ndarray
    errors: Dict[str, float]
    left_out: Dict[str, str]
    deviations: Dict[str, float]

    @property
    def rms(self):
        return float(np.sqrt(np.mean(np.square(list(self.errors.values())))))


def limit(errors):
    """Error (pixels) above which a view is an outlier among the others; never below a quarter of a pixel."""
    errors = np.asarray(list(errors))
    middle = np.median(errors)
    return max(0.25, 3 * middle, middle + 6 * 1.4826 * np.median(np.abs(errors - middle)))


def distortion_flags(radial):
    """Flags of cv2.calibrateCamera for 0 to 3 radial terms."""
    flags = (cv2.CALIB_FIX_K1, cv2.CALIB_FIX_K2, cv2.CALIB_FIX_K3)
    return sum(flags[radial:]) + (cv2.CALIB_ZERO_TANGENT_DIST if radial == 0 else 0)


def fit_camera(name, board, corners, size, known=None, radial=2):
    """CameraFit. corners: N x 2 by view; size: (width, height); known: files.rig.Camera whose intrinsics stay as they are;
    radial: terms of the distortion otherwise."""
    K, D, flags = (known.K, known.D, KNOWN) if known else (None, None, distortion_flags(radial))
    if known and len(D) > 5:
        flags |= cv2.CALIB_RATIONAL_MODEL
    left_out = {}
    while True:
        kept = [view for view in corners if view not in left_out]
        if len(kept) < MIN_VIEWS:
            raise ValueError(f"the {name} camera: {len(kept)} usable views of the board, at least {MIN_VIEWS} "
                             "are needed, 20 are good")
        try:
            _, found_K, found_D, _, _, deviations, _, errors = cv2.calibrateCameraExtended(
                [board.points] * len(kept), [corners[view].astype(np.float32) for view in kept], size,
                *(None if part is None else part.copy() for part in (K, D)), flags=flags, criteria=CAMERA_CRITERIA)
        except cv2.error as error:  # of a known camera: its principal point lies outside the picture
            remedy = f"compare --{name}-info with the pictures" if known else "tilt the board differently in each"
            raise ValueError(f"the {name} camera: its views do not determine a calibration ({error.err}): {remedy}")
        errors = dict(zip(kept, errors.ravel().tolist()))
        worst = max(errors, key=errors.get)
        if errors[worst] <= limit(errors.values()):
            if known:
                return CameraFit(K, D, errors, left_out, {})
            return CameraFit(found_K, found_D.ravel()[:5], errors, left_out, dict(zip(TERMS, deviations.ravel().tolist())))
        # One at a time: a very bad view increases the errors of the others.
        left_out[worst] = f"{errors[worst]:.2f} px in the {name} picture, far above the others"


def board_pose(board, corners, K, D):
    """Rotation vector and position (m) of the board."""
    on_board, seen = board.points.astype(np.float64), corners.astype(np.float64)
    _, rotation, position = cv2.solvePnP(on_board, seen, K, D, flags=cv2.SOLVEPNP_IPPE)
    return cv2.solvePnPRefineLM(on_board, seen, K, D, rotation, position)


def _pose_matrix(rotation, position):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(rotation)[0], np.ravel(position)
    return pose


def agree(board, pairs, depth, color, width):
    """Finds the pose of one camera in the other on which most views agree.

    A board looks alike from two sides, a square one from four, so a single picture does not tell which corner is the
    first. The cameras do not move on the rig, and a wrong choice gives another relative pose in each view: the pose
    that most views share is the right one. Returns two dicts by view: the colour picture's corners in the order of the
    depth picture's, and why a view is left out before the fit. The poses of single views are not precise, so only gross
    outliers are.

    pairs: Pair with both corners; depth, color: CameraFit; width: of the colour picture.
    """
    poses = [_pose_matrix(*board_pose(board, pair.depth, depth.K, depth.D)) for pair in pairs]
    orders = [board.orders(pair.color) for pair in pairs]
    flat = np.array([[cv2.undistortPoints(order.astype(np.float64).reshape(-1, 1, 2), color.K, color.D)[:, 0]
                      for order in view] for view in orders])  # views x orders x corners x 2
    points = np.concatenate([board.points, np.ones((len(board.points), 1))], axis=1)
    in_depth = np.array([pose @ points.T for pose in poses])  # views x 4 x corners
    focal = (color.K[0, 0] + color.K[1, 1]) / 2

    def errors(candidate):
        """RMS distance in pixels, views x orders."""
        seen = candidate[:3] @ in_depth
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.moveaxis(seen[:, :2] / seen[:, 2:], 1, 2)
        off = np.sqrt(np.mean(np.sum((seen[:, None] - flat) ** 2, axis=3), axis=2)) * focal
        return np.where(np.isfinite(off), off, np.inf)

    best, best_cost = None, np.inf
    for order in range(len(orders[0])):
        for view, pose in enumerate(poses):
            candidate = _pose_matrix(*board_pose(board, orders[view][order], color.K, color.D)) @ np.linalg.inv(pose)
            off = errors(candidate)
            cost = np.minimum(off.min(axis=1), ROBUST_COST_CAP * width).sum()
            if cost < best_cost:
                best, best_cost = off, cost
    pixels = best.min(axis=1)
    bound = min(max(0.01 * width, 6 * np.median(pixels)), ROBUST_COST_CAP * width)
    left_out = {pair.name: f"{off:.0f} px from where the other pairs put it: {MOVED}"
                for pair, off in zip(pairs, pixels) if off > bound}
    return {pair.name: view[off.argmin()] for pair, view, off in zip(pairs, orders, best)}, left_out


@dataclass
class RigFit:
    """X_color = R X_depth + t (m). errors: pixels RMS of each camera by pair; remarks: pair -> why it is not used, or by one
    camera only.

    deviations: standard deviations of t (m, 3), of the rotation (rad) and of the place of a depth pixel in the colour
    picture (pixels, RMS over the picture and DEPTHS).
    """
    depth: CameraFit
    color: CameraFit
    R: np.ndarray
    t: np.ndarray
    errors: Dict[str, Tuple[float, float]]
    remarks: Dict[str, str]
    jointly: bool
    deviations: tuple
    rms = CameraFit.rms


def fit_rig(board, pairs: List, sizes, known=(None, None), radial=2):
    """RigFit of board.Pairs; sizes: ((width, height) of the depth, of the colour camera); known: rig.Camera or None."""
    fits = []
    for name, size, camera in zip(CAMERAS, sizes, known):
        if camera and (camera.width, camera.height) != tuple(size):
            raise ValueError(f"the {name} camera's known calibration is for {camera.width}x{camera.height} "
                             f"pixels, its pictures have {size[0]}x{size[1]}")
        corners = {pair.name: getattr(pair, name) for pair in pairs if getattr(pair, name) is not None}
        fits.append(fit_camera(name, board, corners, size, camera, radial))
    both = [pair for pair in pairs if pair.depth is not None and pair.color is not None
            and not any(pair.name in fit.left_out for fit in fits)]
    if len(both) < MIN_PAIRS:
        raise ValueError(f"{len(both)} usable pairs show the board to both cameras, at least {MIN_PAIRS} are "
                         "needed, 20 are good")
    order, left_out = agree(board, both, *fits, sizes[1][0])
    # Refined together, the intrinsics of both cameras fit each other: in the tests a depth pixel is then mapped more
    # precisely than with each camera's own. With few pairs among many single views the single views know more.
    jointly = known == (None, None) and all(2 * len(both) >= len(fit.errors) for fit in fits)
    solve = partial(_solve, board, {pair.name: (pair.depth, order[pair.name]) for pair in both}, fits, sizes[0],
                    distortion_flags(radial) if jointly else None)
    while True:
        kept = [pair.name for pair in both if pair.name not in left_out]
        if 2 * len(kept) < len(both) or len(kept) < MIN_PAIRS:
            raise ValueError(f"the cameras' relative pose differs from pair to pair (only {len(kept)} of "
                             f"{len(both)} agree): were the cameras or the board moved, or is one camera's "
                             "picture mirrored?")
        solution, errors = solve(kept)
        total = {name: float(np.hypot(*error)) for name, error in errors.items()}
        worst = max(total, key=total.get)
        if total[worst] <= limit(total.values()):
            break
        left_out[worst] = f"{total[worst]:.2f} px in the pair, far above the others: {MOVED}"
    Ks, Ds, R, t = solution
    for fit, K, D in zip(fits, Ks, Ds):
        fit.K, fit.D = K, D
    remarks = {pair.name: pair.problem for pair in pairs if pair.problem}
    for part in (left_out, *(fit.left_out for fit in fits)):
        remarks.update({name: f"left out: {reason}" for name, reason in part.items()})
    return RigFit(*fits, R, t, errors, remarks, jointly, _deviations(solve, kept, solution, sizes))


def _solve(board, corners, fits, size, flags, names):
    """cv2.stereoCalibrate on the pairs of these names: (K and D of both cameras, R, t), errors by pair as in RigFit. corners: of
    both cameras by pair; size: of the depth camera's pictures; flags None: intrinsics stay as they are."""
    fixed = flags is None
    flags = cv2.CALIB_FIX_INTRINSIC if fixed else flags | cv2.CALIB_USE_INTRINSIC_GUESS
    if any(len(fit.D) > 5 for fit in fits):  # only known cameras have more
        flags |= cv2.CALIB_RATIONAL_MODEL
    seen = [[np.ascontiguousarray(corners[name][camera], np.float32) for name in names] for camera in (0, 1)]
    start = [array.copy() for fit in fits for array in (fit.K, fit.D)]
    result = cv2.stereoCalibrateExtended([board.points] * len(names), *seen, *start, size, np.eye(3), np.zeros((3, 1)),
                                         flags=flags, criteria=RIG_CRITERIA)
    _, K1, D1, K2, D2, R, t = result[:7]
    # Versions of OpenCV differ in what they return between these and the last.
    errors = {name: tuple(map(float, error)) for name, error in zip(names, result[-1])}
    K, D = ([fit.K for fit in fits], [fit.D for fit in fits]) if fixed else ([K1, K2], [np.ravel(D1), np.ravel(D2)])
    return (K, D, R, t.ravel()), errors


def map_points(K, D, R, t, size):
    """Places in the colour picture (N x 2) of a grid of depth pixels at DEPTHS; K, D: of both cameras."""
    u, v = np.meshgrid(np.linspace(0.05, 0.95, 7) * size[0], np.linspace(0.05, 0.95, 5) * size[1])
    rays = cv2.undistortPoints(np.stack([u, v], axis=-1).reshape(-1, 1, 2), K[0], D[0])[:, 0]
    rays = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    points = np.concatenate([rays * z for z in DEPTHS])
    return cv2.projectPoints(points, cv2.Rodrigues(R)[0], t, K[1], D[1])[0][:, 0]


def _deviations(solve, names, whole, sizes):
    """Standard deviations by the jackknife: leaves out one group of views after the other and looks what changes."""
    groups = min(GROUPS, len(names))
    _, _, whole_R, _ = whole
    found, seen = [], map_points(*whole, sizes[0])
    inside = ((seen >= 0) & (seen < sizes[1])).all(axis=1)
    for group in range(groups):
        part, _ = solve([name for number, name in enumerate(names) if number % groups != group])
        _, _, R, t = part
        rotation = cv2.Rodrigues(R @ whole_R.T)[0].ravel()
        found.append(np.concatenate([t, rotation, map_points(*part, sizes[0])[inside].ravel()]))
    deviations = np.std(found, axis=0) * np.sqrt(groups - 1)
    mapping = float(np.sqrt(np.mean(deviations[6:] ** 2) * 2)) if inside.any() else None
    return deviations[:3], float(np.linalg.norm(deviations[3:6])), mapping
