# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One camera's intrinsics from its views of the board, bad views left out."""
from dataclasses import dataclass
from typing import Dict

import cv2
import numpy as np

from all_in_focus.calibration import CalibrationError

MIN_VIEWS = 5
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-8)
TERMS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


@dataclass
class CameraFit:
    """K 3x3, D 5; by view: errors (RMS, pixels) and those left out with the reason; deviations: standard, by term."""
    K: np.ndarray
    D: np.ndarray
    errors: Dict[str, float]
    left_out: Dict[str, str]
    deviations: Dict[str, float]
    tilts: Dict[str, np.ndarray]  # normal of the board, in the camera

    @property
    def rms(self):
        return float(np.sqrt(np.mean(np.square(list(self.errors.values())))))


def limit(errors):
    """Error above which a view does not belong to the others: pixels. Below a quarter none is worth a word."""
    errors = np.asarray(list(errors))
    middle = np.median(errors)
    return max(0.25, 3 * middle, middle + 6 * 1.4826 * np.median(np.abs(errors - middle)))


def distortion_flags(radial):
    """calibrateCamera's, for 0 to 3 radial terms."""
    flags = (cv2.CALIB_FIX_K1, cv2.CALIB_FIX_K2, cv2.CALIB_FIX_K3)
    return sum(flags[radial:]) + (cv2.CALIB_ZERO_TANGENT_DIST if radial == 0 else 0)


def fit_camera(name, board, corners, size, radial=2):
    """CameraFit. corners: N x 2 by view; size: (width, height); radial: terms of the distortion."""
    left_out = {}
    while True:
        kept = [view for view in corners if view not in left_out]
        if len(kept) < MIN_VIEWS:
            raise CalibrationError("the %s camera: %d usable views of the board, at least %d are needed, 20 are good"
                                   % (name, len(kept), MIN_VIEWS))
        try:
            _, K, D, turns, _, deviations, _, errors = cv2.calibrateCameraExtended(
                [board.points] * len(kept), [corners[view].astype(np.float32) for view in kept], size, None, None,
                flags=distortion_flags(radial), criteria=CRITERIA)
        except cv2.error:
            raise CalibrationError("the %s camera: its views admit no calibration: tilt the board, each time otherwise"
                                   % name)
        errors = dict(zip(kept, errors.ravel().tolist()))
        worst = max(errors, key=errors.get)
        if errors[worst] <= limit(errors.values()):
            return CameraFit(K, D.ravel()[:5], errors, left_out, dict(zip(TERMS, deviations.ravel().tolist())),
                             {view: cv2.Rodrigues(turn)[0][:, 2] for view, turn in zip(kept, turns)})
        # One at a time: a very bad view makes others look bad.
        left_out[worst] = "%.2f px in the %s picture, far above the others" % (errors[worst], name)


def known_camera(name, board, corners, camera):
    """CameraFit of a camera that is known already (rig.Camera)."""
    errors, tilts = {}, {}
    for view, points in corners.items():
        pose = board_pose(board, points, camera.K, camera.D)
        seen = cv2.projectPoints(board.points, *pose, camera.K, camera.D)[0].reshape(-1, 2)
        errors[view] = float(np.sqrt(np.mean(np.sum((seen - points) ** 2, axis=1))))
        tilts[view] = cv2.Rodrigues(pose[0])[0][:, 2]
    bound = limit(errors.values()) if errors else 0
    left_out = {view: "%.2f px in the %s picture, far above the others" % (error, name)
                for view, error in errors.items() if error > bound}
    errors = {view: error for view, error in errors.items() if view not in left_out}
    return CameraFit(camera.K, camera.D, errors, left_out, {}, tilts)


def board_pose(board, corners, K, D):
    """Rotation vector and position (m) of the board."""
    on_board, seen = board.points.astype(np.float64), corners.astype(np.float64)
    _, turn, position = cv2.solvePnP(on_board, seen, K, D, flags=cv2.SOLVEPNP_IPPE)
    return cv2.solvePnPRefineLM(on_board, seen, K, D, turn, position)
