# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A focus bracket through a thin lens: layered defocus with occlusion, in linear light.

Distances are in mm, blur circles in pixels of pitch f / fx.
"""
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import cv2
import numpy as np
from scipy.ndimage import find_objects

from all_in_focus.imaging import linear_to_srgb

LEVEL_STEP_PX = 0.25  # blur circles are rounded to multiples of this diameter
COARSE_STEPS = 128    # a blur circle of more steps than this is rounded to two steps, then four, and so on
SHARP_PX = 1.0        # a centred disc of this diameter or less lies inside its own pixel
COVERAGE_FLOOR = 1e-6
TILE_PX = 1024        # large pictures are rendered tile by tile, so that memory does not grow with the layers
NOISE_ROWS = 256      # rows that get their noise at once


@dataclass
class Layer:
    """One surface of a scene, seen from the colour camera, on an H x W canvas.

    color: H x W x 3, linear light; alpha: H x W, 0..1, also where nearer layers hide it; depth: H x W, mm, finite
    everywhere; weight: H x W, confidence in a pixel's colour (small: invented behind an occluder), 0 outside alpha.
    """
    color: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray
    weight: np.ndarray

    def crop(self, rows, cols):
        """The layer seen through a window of its canvas (two slices)."""
        return Layer(self.color[rows, cols], self.alpha[rows, cols], self.depth[rows, cols], self.weight[rows, cols])


def image_distance(f, s):
    """Distance (mm) behind a lens of focal length f at which an object at s is sharp."""
    return f * s / (s - f)


def blur_circle_px(optics, fx, u, s):
    """Diameter (pixels of pitch f / fx) of the blur circle of a point at distance u, focused at s: f^2/F |u - s| / (u (s - f))
    on the sensor."""
    f = optics.focal_length_mm
    return f * f / optics.aperture * np.abs(u - s) / (u * (s - f)) * fx / f


def focus_distances(near, far, count):
    """`count` distances (mm), near to far, equally spaced in dioptres; a single one lies in the dioptric middle."""
    if count == 1:
        return np.array([2 / (1 / near + 1 / far)])
    return 1 / np.linspace(1 / near, 1 / far, count)


def breathing_scale(f, s, s_reference, breathing):
    """Magnification of a frame focused at s relative to one focused at s_reference."""
    return 1 + breathing * (image_distance(f, s) / image_distance(f, s_reference) - 1)


@lru_cache(maxsize=None)
def disc_kernel(level):
    """Kernel of a disc of diameter level * LEVEL_STEP_PX: the covered share of each pixel, sum 1."""
    samples = 16
    radius = max(level * LEVEL_STEP_PX, SHARP_PX) / 2
    half = max(0, int(np.ceil(radius - 0.5)))
    size = 2 * half + 1
    axis = (np.arange(size * samples) + 0.5) / samples - size / 2
    inside = axis[:, None] ** 2 + axis[None, :] ** 2 <= radius ** 2
    kernel = inside.reshape(size, samples, size, samples).mean(axis=(1, 3))
    return (kernel / kernel.sum()).astype(np.float32)


def window_around(mask, pad):
    """Smallest window (two slices) around a mask, widened by pad and cut at the border; None if the mask is empty."""
    for box in find_objects(mask.astype(np.uint8)):
        return tuple(slice(max(0, side.start - pad), min(side.stop + pad, size)) for side, size in zip(box, mask.shape))


def tiles_of(window, side_px):
    """Windows (two slices) of at most side_px x side_px pixels that make up a window."""
    for rows, cols in product(*(range(side.start, side.stop, side_px) for side in window)):
        yield slice(rows, min(rows + side_px, window[0].stop)), slice(cols, min(cols + side_px, window[1].stop))


def blur_levels(diameter_px):
    """Blur circles in pixels -> whole multiples of LEVEL_STEP_PX, 0 where the pixel stays untouched.

    The rounding stays below 1 % of a large circle: fewer levels, fewer passes over a slanted surface.
    """
    steps = diameter_px / LEVEL_STEP_PX
    coarse = 2.0 ** np.ceil(np.log2(np.maximum(steps / COARSE_STEPS, 1)))
    level = (np.rint(steps / coarse) * coarse).astype(np.int32)
    return np.where(level * LEVEL_STEP_PX <= SHARP_PX, 0, level)


def blur_layer(layer, level):
    """Spread every pixel of a layer over its own blur circle.

    level: H x W from blur_levels. Returns colour (H x W x 3, not premultiplied) and coverage (H x W). Both are
    normalised sums: colours by the weight that arrived, so that unknown neighbours leave no dark fringe, and coverage
    by what an unbounded surface of this depth would give.
    """
    source = np.dstack([layer.color * layer.weight[..., None], layer.weight, layer.alpha, np.ones_like(layer.alpha)])
    if not level.any():
        spread = source
    else:
        spread = np.zeros_like(source)
        for value in np.unique(level):
            here = level == value
            kernel = disc_kernel(int(value))
            window = window_around(here, kernel.shape[0] // 2)
            part = source[window] * here[window][..., None]
            spread[window] += cv2.filter2D(part, -1, kernel, borderType=cv2.BORDER_CONSTANT)
    color = spread[..., :3] / np.maximum(spread[..., 3:4], COVERAGE_FLOOR)
    return color, np.clip(spread[..., 4] / np.maximum(spread[..., 5], COVERAGE_FLOOR), 0, 1)


def composite(layers, diameter_of=None):
    """Layers, back to front, composited in linear light (H x W x 3).

    diameter_of: depth (mm) -> blur circle (px); None: the pinhole picture, sharp everywhere.
    """
    height, width = layers[0].alpha.shape
    reach = 0
    if diameter_of is not None:  # the widest circle belongs to the nearest or the farthest depth
        ends = np.float32([end for layer in layers for end in (layer.depth.min(), layer.depth.max())])
        reach = disc_kernel(int(blur_levels(diameter_of(ends)).max())).shape[0] // 2
    light = np.empty((height, width, 3), np.float32)
    for rows, cols in tiles_of((slice(0, height), slice(0, width)), TILE_PX):
        wide = [slice(max(0, side.start - reach), side.stop + reach) for side in (rows, cols)]
        tile = _composite_tile([layer.crop(*wide) for layer in layers], diameter_of)
        tile = tile[rows.start - wide[0].start:, cols.start - wide[1].start:]
        light[rows, cols] = tile[:rows.stop - rows.start, :cols.stop - cols.start]
    return light


def _composite_tile(layers, diameter_of):
    """The picture of `composite` for one tile."""
    shape = layers[0].alpha.shape
    light, covered = np.zeros(shape + (3,), np.float32), np.zeros(shape, np.float32)
    for layer in layers:
        if not layer.alpha.any():
            continue
        level = np.zeros(shape, np.int32) if diameter_of is None else blur_levels(diameter_of(layer.depth))
        # Twice the radius of the widest disc: blur_layer divides by the weights that arrive, so it needs all that do.
        window = window_around(layer.alpha > 0, disc_kernel(int(level.max())).shape[0] // 2 * 2)
        color, coverage = blur_layer(layer.crop(*window), level[window])
        light[window] += coverage[..., None] * (color - light[window])
        covered[window] += coverage * (1 - covered[window])
    return light / np.maximum(covered, COVERAGE_FLOOR)[..., None]


def motion(center, scale=1.0, roll=0.0, shift=(0.0, 0.0)):
    """Similarity transform (2x3) of a picture: scale and rotation (degrees, clockwise) about a pixel (x, y), then a shift
    by (x, y) pixels."""
    c, s = scale * np.cos(np.radians(roll)), scale * np.sin(np.radians(roll))
    linear = np.array([[c, -s], [s, c]])
    return np.column_stack([linear, np.array(center) - linear @ center + shift])


def warp(picture, matrix):
    """Warps a picture by the matrix of `motion` to the same size; returns it unchanged for the identity."""
    if np.array_equal(matrix, np.eye(2, 3)):
        return picture
    moved = cv2.warpAffine(picture, matrix, picture.shape[1::-1], flags=cv2.INTER_LANCZOS4,
                           borderMode=cv2.BORDER_REPLICATE)
    return np.maximum(moved, 0)


@dataclass(frozen=True)
class Sag:
    """A tripod head that gives way: total motion from the first frame of a bracket to the last, at a constant rate."""
    roll_degrees: float = 0.0
    right_px: float = 0.0
    down_px: float = 0.0


def frame_motions(camera, optics, distances, breathing=0.0, sag=Sag()):
    """Similarity transform (2x3) of each frame against the reference frame N // 2, one for each focus distance."""
    reference, last = len(distances) // 2, max(1, len(distances) - 1)
    for number, s in enumerate(distances):
        share = (number - reference) / last
        yield motion((camera.K[0, 2], camera.K[1, 2]),
                     breathing_scale(optics.focal_length_mm, s, distances[reference], breathing),
                     share * sag.roll_degrees, (share * sag.right_px, share * sag.down_px))


def drift_path(count, drift_mm, seed=0):
    """Places of the camera (count x 3, mm: right, down, ahead) seen from its place in the reference frame N // 2: a random
    walk, whose steps ahead are half as wide; the greatest distance is drift_mm."""
    steps = np.random.default_rng([seed, 7]).normal(size=(count, 3)) * (1, 1, 0.5)
    path = np.cumsum(steps, axis=0)
    path -= path[count // 2]
    farthest = np.linalg.norm(path, axis=1).max()
    return path * (drift_mm / farthest if farthest > 0 else 0)


def vignette(camera, corner_loss, f, s, s_reference):
    """Gain of each pixel (H x W): in the corners the reference frame loses a share corner_loss of the light.

    The loss grows with the square of the angle to the axis. The angle of a corner depends on the image distance, so
    frames differ.
    """
    x, y = np.arange(camera.width) - camera.K[0, 2], np.arange(camera.height) - camera.K[1, 2]
    corner = max(abs(x[0]), abs(x[-1])) ** 2 + max(abs(y[0]), abs(y[-1])) ** 2
    loss = corner_loss * (image_distance(f, s_reference) / image_distance(f, s)) ** 2
    return np.float32(1 - loss * (x ** 2 + (y ** 2)[:, None]) / corner)


def render_frame(scene, optics, s, matrix=np.eye(2, 3)):
    """One frame of a scene focused at s (mm), in linear light, of the colour camera's size; matrix: see `motion`."""
    camera = scene.rig.color
    near, far = min(layer.depth.min() for layer in scene.layers), max(layer.depth.max() for layer in scene.layers)
    widest = max(blur_circle_px(optics, camera.K[0, 0], u, s) for u in (near, far))
    moved = np.abs(matrix - np.eye(2, 3)) @ [camera.width, camera.height, 1]
    pad = int(np.ceil(widest)) + 4 + int(np.ceil(moved.max()))
    inner = scene.frame_window(pad)
    light = composite([layer.crop(*inner) for layer in scene.layers],
                      lambda depth: blur_circle_px(optics, camera.K[0, 0], depth, s))
    top, left = (window.start for window in scene.frame_window(0))
    offset = np.array([left - inner[1].start, top - inner[0].start])
    matrix = np.column_stack([matrix[:, :2], matrix[:, 2] + offset - matrix[:, :2] @ offset])
    return warp(light, matrix)[offset[1]:offset[1] + camera.height, offset[0]:offset[0] + camera.width]


def expose(light, rng=None, gain=1.0, noise=0.0, linear=False):
    """Linear light -> 8-bit picture, with a gain in linear light and gaussian noise in 8-bit units.

    linear: codes in proportion to light instead of sRGB.
    """
    image = np.empty(light.shape, np.uint8)
    for row in range(0, len(light), NOISE_ROWS):
        gained = light[row:row + NOISE_ROWS] * np.float32(gain)
        code = 255 * np.minimum(gained, 1) if linear else linear_to_srgb(gained)
        if noise > 0:
            code = code + rng.normal(0, noise, code.shape)
        image[row:row + NOISE_ROWS] = np.clip(np.rint(code), 0, 255)
    return image


@dataclass(frozen=True)
class Disturbance:
    """What keeps a bracket from being a still scene through an ideal lens."""
    breathing: float = 0.0        # 1: as a simple thin lens has it
    noise: float = 0.0            # standard deviation, 8-bit units
    exposure_jitter: float = 0.0  # per-frame gain exp(N(0, this)) in linear light
    vignetting: float = 0.0       # share of the light lost in the corners of the reference frame
    sag: Sag = Sag()
    drift_mm: float = 0.0         # greatest distance of the camera from its place in the reference frame
    drift_seed: int = 0


def render_bracket(scene, optics, distances, disturbance=Disturbance(), seed=0, linear=False):
    """Yield the 8-bit frames of a bracket, one per focus distance; frame N // 2 stays in place and keeps gain 1.

    linear: see expose().
    """
    rng = np.random.default_rng([seed, 1])
    reference, camera = len(distances) // 2, scene.rig.color
    gains = np.exp(rng.normal(0, disturbance.exposure_jitter, len(distances)))
    gains[reference] = 1
    motions = frame_motions(camera, optics, distances, disturbance.breathing, disturbance.sag)
    places = drift_path(len(distances), disturbance.drift_mm, disturbance.drift_seed)
    for s, gain, matrix, place in zip(distances, gains, motions, places):
        light = render_frame(scene.seen_from(place), optics, s, matrix)
        if disturbance.vignetting > 0:
            light *= vignette(camera, disturbance.vignetting, optics.focal_length_mm, s, distances[reference])[..., None]
        yield expose(light, rng, gain, disturbance.noise, linear)
