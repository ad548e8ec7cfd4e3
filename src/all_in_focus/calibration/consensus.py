# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The pose of one camera in the other on which most views agree, and how the board lies in each.

A board looks alike from two sides (a square one from four), so each picture leaves open which corner is the first. One
view does not tell; but the cameras stand still on the rig, and a wrong choice means another relative pose in each view.
"""
import cv2
import numpy as np

from all_in_focus.calibration.camera_fit import board_pose

OTHERWISE = 0.04  # of the picture's width: a view that is farther off says nothing about the pose


def _matrix(turn, position):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(turn)[0], np.ravel(position)
    return pose


def _orders(board, pair):
    """Orders of the corners in the colour picture; first as if both cameras were the same way up."""
    along = pair.depth[board.columns - 1] - pair.depth[0]
    return sorted(board.orders(pair.color), key=lambda corners: -np.dot(corners[board.columns - 1] - corners[0], along))


def agree(board, pairs, depth, color, width):
    """(by view: the colour picture's corners in the depth picture's order; by view: pixels off the common pose).

    pairs: Pair with both corners; depth, color: CameraFit; width: of the colour picture.
    """
    poses = [_matrix(*board_pose(board, pair.depth, depth.K, depth.D)) for pair in pairs]
    orders = [_orders(board, pair) for pair in pairs]
    flat = np.array([[cv2.undistortPoints(order.astype(np.float64).reshape(-1, 1, 2), color.K, color.D)[:, 0]
                      for order in view] for view in orders])  # views x orders x corners x 2
    points = np.concatenate([board.points, np.ones((len(board.points), 1))], axis=1)
    in_depth = np.array([pose @ points.T for pose in poses])  # views x 4 x corners
    focal = (color.K[0, 0] + color.K[1, 1]) / 2

    def errors(candidate):
        """Pixels off, views x orders."""
        seen = candidate[:3] @ in_depth
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.moveaxis(seen[:, :2] / seen[:, 2:], 1, 2)
        off = np.sqrt(np.mean(np.sum((seen[:, None] - flat) ** 2, axis=3), axis=2)) * focal
        return np.where(np.isfinite(off), off, np.inf)

    best, best_cost = None, np.inf
    for order in range(len(orders[0])):
        for view, pose in enumerate(poses):
            candidate = _matrix(*board_pose(board, orders[view][order], color.K, color.D)) @ np.linalg.inv(pose)
            off = errors(candidate)
            cost = np.minimum(off.min(axis=1), OTHERWISE * width).sum()
            if cost < best_cost * (1 - 1e-6):
                best, best_cost = off, cost
    chosen = best.argmin(axis=1)
    return ({pair.name: view[order] for pair, view, order in zip(pairs, orders, chosen)},
            {pair.name: float(off[order]) for pair, off, order in zip(pairs, best, chosen)})
