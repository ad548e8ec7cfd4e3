# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a structured-light depth camera (Kinect v1) sees of a layered scene.

Depth maps are H x W in mm, 0 = no measurement.
"""
from dataclasses import dataclass

import cv2
import numpy as np

from all_in_focus.imaging import fill_from_farther


@dataclass
class KinectModel:
    """Errors and limits of the sensor."""
    baseline_mm: float = 75.0          # the projector stands to the right of the camera
    focal_px: float = 580.0            # of the sensor's own disparity
    disparity_step_px: float = 0.125   # so depth comes in steps of z^2 / (focal * baseline) * 0.125
    disparity_noise_px: float = 0.04   # standard deviation
    edge_jitter_px: float = 0.7        # standard deviation of the lateral error at depth edges
    correlation_px: float = 1.0        # both errors are correlated over about this distance
    min_range_mm: float = 500.0
    max_range_mm: float = 5500.0       # the nominal 5 m, and a little: measurements do go on beyond it
    dead_columns: int = 8              # at the right edge, where the correlation window ends
    depth_edge: float = 0.03           # relative step in depth that makes an edge


def nearest_depth(index, z, size):
    """Z-buffer: per cell the mean depth of the points within 2 % of its nearest one, 0 where no point fell."""
    order = np.argsort(-z, kind="stable")
    nearest = np.zeros(size, np.float64)
    nearest[index[order]] = z[order]  # the last, nearest, write wins
    front = z <= nearest[index] * 1.02
    count = np.bincount(index[front], minlength=size)
    return np.bincount(index[front], z[front], minlength=size) / np.maximum(count, 1)


def layer_points(layer, color, origin, oversampling):
    """Surface points of a layer in the colour camera, N x 3 in mm; origin: canvas position of pixel (0, 0), (x, y)."""
    n = oversampling
    depth, alpha = (cv2.resize(values, None, fx=n, fy=n) for values in (layer.depth, layer.alpha))
    rows, cols = np.nonzero(alpha >= 0.5)
    z = depth[rows, cols].astype(np.float64)
    x = ((cols + 0.5) / n - 0.5 - origin[0] - color.K[0, 2]) / color.K[0, 0]
    y = ((rows + 0.5) / n - 0.5 - origin[1] - color.K[1, 2]) / color.K[1, 1]
    return np.stack([x * z, y * z, z], axis=1)


def warp_to_depth_camera(scene):
    """True depth (mm, float) of a scene in the depth camera of its rig; small gaps are filled from the farther side."""
    scene = scene.seen_by_depth or scene
    camera, color = scene.rig.depth, scene.rig.color
    oversampling = max(1, int(np.ceil(2 * camera.K[0, 0] / color.K[0, 0])))
    window = scene.frame_window(0)
    origin = (window[1].start, window[0].start)
    points = np.concatenate([layer_points(layer, color, origin, oversampling) for layer in scene.layers])
    points = (points - 1000 * scene.rig.t) @ scene.rig.R  # rows: R^T (X - t)
    z = points[:, 2]
    u = np.floor(points[:, 0] / z * camera.K[0, 0] + camera.K[0, 2] + 0.5).astype(np.int64)
    v = np.floor(points[:, 1] / z * camera.K[1, 1] + camera.K[1, 2] + 0.5).astype(np.int64)
    seen = (z > 0) & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    size = camera.width * camera.height
    depth = nearest_depth(v[seen] * camera.width + u[seen], z[seen], size).reshape(camera.height, camera.width)
    return fill_from_farther(depth)


def projector_shadow(depth, focal_px, baseline_mm):
    """Mask of the pixels that the projector, baseline_mm to the right, does not light."""
    height, width = depth.shape
    fine = 4  # columns per pixel, so that slanted surfaces have no gaps in the projector's view
    z = np.repeat(depth, fine, axis=1)
    cells = width * fine * 2
    with np.errstate(divide="ignore"):
        shift = np.where(z > 0, focal_px * baseline_mm / np.where(z > 0, z, 1), 0)
    column = np.floor((np.arange(width * fine)[None, :] / fine - shift) * 2 + width * fine).astype(np.int64)
    inside = (z > 0) & (column >= 0) & (column < cells)
    index = (np.arange(height)[:, None] * cells + column)
    buffer = nearest_depth(index[inside], z[inside], height * cells)
    lit = np.zeros(z.shape, bool)
    lit[inside] = z[inside] <= buffer[index[inside]] * 1.02 + 10
    return lit.reshape(height, width, fine).mean(axis=2) < 0.5


def _correlated(rng, shape, deviation, correlation):
    """Gaussian noise of a given standard deviation, correlated over some pixels."""
    noise = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), correlation)
    return noise * (deviation / noise.std())


def measure(depth, focal_px, rng):
    """What the sensor reports (uint16 mm) where the true depth is `depth`; focal_px: of the depth camera."""
    model = KinectModel()
    z = np.where(projector_shadow(depth, focal_px, model.baseline_mm), 0, depth)

    rows, cols = np.indices(depth.shape)
    jitter = [_correlated(rng, depth.shape, model.edge_jitter_px, model.correlation_px) for _ in range(2)]
    moved = z[np.clip(np.rint(rows + jitter[0]).astype(int), 0, depth.shape[0] - 1),
              np.clip(np.rint(cols + jitter[1]).astype(int), 0, depth.shape[1] - 1)]
    z = np.where(np.abs(moved - z) > model.depth_edge * z, moved, z)

    known = (z >= model.min_range_mm) & (z <= model.max_range_mm)
    disparity = model.focal_px * model.baseline_mm / np.where(known, z, 1)
    disparity += _correlated(rng, depth.shape, model.disparity_noise_px, model.correlation_px)
    disparity = np.rint(disparity / model.disparity_step_px) * model.disparity_step_px
    known &= disparity > 0
    z = np.where(known, model.focal_px * model.baseline_mm / np.where(known, disparity, 1), 0)
    z[:, z.shape[1] - model.dead_columns:] = 0
    return np.rint(z).astype(np.uint16)


def simulate(scene, seed=0):
    """Raw depth picture (uint16 mm) of a scene."""
    return measure(warp_to_depth_camera(scene), scene.rig.depth.K[0, 0], np.random.default_rng([seed, 2]))
