# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where a depth image jumps, and where a rig puts that in the colour picture."""
from dataclasses import dataclass

import cv2
import numpy as np

from all_in_focus.imaging import fill_from_farther

JUMP = 0.06  # of the nearer depth
STEADY = 3  # times the change of depth on either side: a jump, no slope
BORDER = 4  # pixels
HIDDEN = 0.96  # of a point's depth: what is nearer than that hides it
CELL = 6  # pixels of the colour picture


@dataclass
class Contours:
    """Border points of near things: at N x 2 in the colour picture, pixels; normal N x 2 points to the farther side.
    far: M x 2, where the farther side begins."""
    at: np.ndarray
    normal: np.ndarray
    far: np.ndarray


def _jumps(filled, measured, axis):
    """(near, far): row and column of the pixels on both sides of each jump along an axis, N x 2."""
    step = np.diff(filled, axis=axis)
    size = np.abs(step)
    one, other = (np.delete(filled, index, axis=axis) for index in (-1, 0))
    lower = np.minimum(one, other)
    before, after = np.roll(size, 1, axis), np.roll(size, -1, axis)
    found = (lower > 0) & (size > JUMP * lower) & (size > STEADY * np.minimum(before, after))
    first = np.argwhere(found)
    second = first + (np.arange(2) == axis)
    forward = (step[found] > 0)[:, None]  # the second pixel is the farther one
    near, far = np.where(forward, first, second), np.where(forward, second, first)
    inside = ((near >= BORDER) & (near < np.array(filled.shape) - BORDER)).all(axis=1) & measured[tuple(near.T)]
    return near[inside], far[inside]


def depth_jumps(depth):
    """Jumps of a depth image (uint16 mm, 0 = unknown): borders (x, y) N x 2 between two pixels, unit normals to the
    farther side, depths (mm) of the nearer and of the farther side."""
    calm = np.where(depth > 0, cv2.medianBlur(depth, 5), 0)
    # A shadow of the projector belongs to what is behind: the jump is at its nearer side.
    filled = fill_from_farther(calm).astype(np.float64)
    sides = [_jumps(filled, calm > 0, axis) for axis in (0, 1)]
    near, far = (np.concatenate(pixels) for pixels in zip(*sides))
    return ((near + far)[:, ::-1] / 2, (far - near)[:, ::-1].astype(float), filled[tuple(near.T)], filled[tuple(far.T)])


def _project(rig, at, z):
    """Depth pixels with depth (mm) in the colour picture: (N x 2, pixels; depth in the colour camera, m)."""
    if len(at) == 0:
        return np.zeros((0, 2)), np.zeros(0)
    depth, color = rig.depth, rig.color
    rays = cv2.undistortPoints(np.asarray(at, float).reshape(-1, 1, 2), depth.K, depth.D)[:, 0]
    points = np.column_stack([rays, np.ones(len(rays))]) * (np.asarray(z, float) / 1000)[:, None]
    return (cv2.projectPoints(points, cv2.Rodrigues(rig.R)[0], rig.t, color.K, color.D)[0][:, 0],
            (points @ rig.R.T + rig.t)[:, 2])


def contours_by_rig(depth, rig):
    """Contours of a depth image of the depth camera, as far as the colour camera sees them."""
    border, normal, near, far = depth_jumps(depth)
    nearest = _nearest(depth, rig)
    at, z = _project(rig, border, near)
    beside, _ = _project(rig, border + normal, near)
    direction = beside - at
    shown = _shown(at, z, nearest, rig.color)
    behind, behind_z = _project(rig, border + normal / 2, far)
    return Contours(at[shown], (direction / np.linalg.norm(direction, axis=1, keepdims=True))[shown],
                    behind[_shown(behind, behind_z, nearest, rig.color)])


def contours_of_registered(depth):
    """Contours of a depth image that is registered to the colour picture already."""
    border, normal, _, _ = depth_jumps(depth)
    return Contours(border, normal, border + normal)


def _cells(at, camera):
    """(index of the cell, whether it is in the picture) of pixels N x 2."""
    inside = ((at >= 0) & (at <= [camera.width - 1, camera.height - 1])).all(axis=1)
    column, row = (np.where(inside[:, None], at, 0) / CELL).astype(int).T
    return row * (camera.width // CELL + 1) + column, inside


def _nearest(depth, rig):
    """Least depth (m) of what lies in each cell of the colour picture."""
    rows, columns = np.nonzero(depth)
    at, z = _project(rig, np.stack([columns, rows], axis=1), depth[rows, columns])
    cell, inside = _cells(at, rig.color)
    nearest = np.full((rig.color.width // CELL + 1) * (rig.color.height // CELL + 1), np.inf)
    np.minimum.at(nearest, cell[inside], z[inside])
    return nearest


def _shown(at, z, nearest, camera):
    cell, inside = _cells(at, camera)
    return inside & (z > 0) & (nearest[cell] > HIDDEN * z)
