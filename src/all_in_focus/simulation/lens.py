# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A focus bracket through a thin lens: layered defocus with occlusion, in linear light.

Distances are in mm, blur circles in mm on the sensor or in pixels of pitch f / fx.
"""
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from all_in_focus.imaging import linear_to_srgb

LEVEL_STEP_PX = 0.25  # blur circles are rounded to multiples of this diameter
SHARP_PX = 1.0        # a centred disc of this diameter or less lies inside its own pixel
COVERAGE_FLOOR = 1e-6


@dataclass
class Layer:
    """One surface of a scene, seen from the colour camera, on an H x W canvas.

    color: H x W x 3, linear light; alpha: H x W, 0..1, also where nearer layers hide it; depth: H x W, mm, finite
    everywhere; weight: H x W, how far a pixel's colour is known (small: invented behind an occluder), 0 outside alpha.
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


def blur_circle_mm(optics, u, s):
    """Diameter (mm) of the blur circle of a point at distance u, focused at s: f^2/F |u - s| / (u (s - f))."""
    f = optics.focal_length_mm
    return f * f / optics.aperture * np.abs(u - s) / (u * (s - f))


def blur_circle_px(optics, fx, u, s):
    """The same in pixels; the pixel pitch is f / fx."""
    return blur_circle_mm(optics, u, s) * fx / optics.focal_length_mm


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
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    return (slice(max(0, rows[0] - pad), rows[-1] + 1 + pad), slice(max(0, cols[0] - pad), cols[-1] + 1 + pad))


def blur_levels(diameter_px):
    """Blur circles in pixels -> whole multiples of LEVEL_STEP_PX, 0 where the pixel stays untouched."""
    level = np.rint(diameter_px / LEVEL_STEP_PX).astype(np.int32)
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
    shape = layers[0].alpha.shape
    light, covered = np.zeros(shape + (3,), np.float32), np.zeros(shape, np.float32)
    for layer in layers:
        level = np.zeros(shape, np.int32) if diameter_of is None else blur_levels(diameter_of(layer.depth))
        window = window_around(layer.alpha > 0, disc_kernel(int(level.max())).shape[0] // 2)
        if window is None:
            continue
        color, coverage = blur_layer(layer.crop(*window), level[window])
        light[window] += coverage[..., None] * (color - light[window])
        covered[window] += coverage * (1 - covered[window])
    return light / np.maximum(covered, COVERAGE_FLOOR)[..., None]


def visible_depth(layers):
    """Depth (mm, H x W) of the nearest layer that covers at least half of a pixel."""
    depth = np.zeros(layers[0].alpha.shape, np.float32)
    for layer in layers:
        depth = np.where(layer.alpha >= 0.5, layer.depth, depth)
    return depth


def magnify(light, scale, center):
    """Scale a picture about a pixel (x, y), same size."""
    to_source = np.float64([[1 / scale, 0, center[0] * (1 - 1 / scale)], [0, 1 / scale, center[1] * (1 - 1 / scale)]])
    scaled = cv2.warpAffine(light, to_source, light.shape[1::-1], flags=cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP,
                            borderMode=cv2.BORDER_REPLICATE)
    return np.maximum(scaled, 0)


def render_frame(scene, optics, s, scale=1.0):
    """One frame of a scene focused at s (mm), in linear light, of the colour camera's size."""
    camera = scene.rig.color
    near, far = min(layer.depth.min() for layer in scene.layers), max(layer.depth.max() for layer in scene.layers)
    widest = max(blur_circle_px(optics, camera.K[0, 0], u, s) for u in (near, far))
    pad = int(np.ceil(widest)) + 4 + int(np.ceil(abs(scale - 1) * max(camera.width, camera.height)))
    inner = scene.frame_window(pad)
    light = composite([layer.crop(*inner) for layer in scene.layers],
                      lambda depth: blur_circle_px(optics, camera.K[0, 0], depth, s))
    top, left = (window.start for window in scene.frame_window(0))
    top, left = top - inner[0].start, left - inner[1].start
    if scale != 1:
        light = magnify(light, scale, (left + camera.K[0, 2], top + camera.K[1, 2]))
    return light[top:top + camera.height, left:left + camera.width]


def expose(light, rng=None, gain=1.0, noise=0.0):
    """Linear light -> 8-bit picture, with a gain in linear light and gaussian noise in 8-bit units."""
    code = linear_to_srgb(light * np.float32(gain))
    if noise > 0:
        code = code + rng.normal(0, noise, code.shape)
    return np.clip(np.rint(code), 0, 255).astype(np.uint8)


def render_bracket(scene, optics, distances, breathing=0.0, noise=0.0, exposure_jitter=0.0, seed=0):
    """Yield the 8-bit frames of a bracket, one per focus distance; frame N // 2 keeps magnification and gain 1."""
    rng = np.random.default_rng([seed, 1])
    reference = len(distances) // 2
    gains = np.exp(rng.normal(0, exposure_jitter, len(distances)))
    gains[reference] = 1
    for s, gain in zip(distances, gains):
        scale = breathing_scale(optics.focal_length_mm, s, distances[reference], breathing)
        yield expose(render_frame(scene, optics, s, scale), rng, gain, noise)
