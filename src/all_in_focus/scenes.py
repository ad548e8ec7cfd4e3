# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scenes as layers of known colour and depth, with a rig that looks at them.

A scene is a function (size, optics, seed) -> Scene; SCENES lists them with their defaults. Lengths of built surfaces
are in metres in the colour camera's frame (X right, Y down, Z forward), depths in mm.
"""
from dataclasses import dataclass
from typing import Callable, List, Tuple

import cv2
import numpy as np
import skimage.data
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from all_in_focus.kinect import fill_from_farther
from all_in_focus.lens import Layer, blur_circle_px, composite, srgb_to_linear, visible_depth, window_around
from all_in_focus.rig import Camera, Optics, Rig, rotation_matrix

INVENTED = 0.01  # weight of a colour that was invented behind an occluder


@dataclass
class Scene:
    """Layers back to front on a canvas that exceeds the colour picture by margin = (columns, rows) on each side."""
    name: str
    rig: Rig
    margin: Tuple[int, int]
    layers: List[Layer]

    def frame_window(self, pad):
        """The colour picture on the canvas, widened by pad pixels where the canvas allows (two slices)."""
        return (slice(max(0, self.margin[1] - pad), self.margin[1] + self.rig.color.height + pad),
                slice(max(0, self.margin[0] - pad), self.margin[0] + self.rig.color.width + pad))

    def _picture(self):
        window = self.frame_window(0)
        return [layer.crop(*window) for layer in self.layers]

    def truth(self):
        """The all-in-focus picture, linear light."""
        return composite(self._picture())

    def truth_depth(self):
        """True depth (mm) in the colour camera."""
        return visible_depth(self._picture())


def kinect_beside(color, optics):
    """Rig of a Kinect next to the colour camera, turned a little."""
    depth = Camera.pinhole("kinect_depth", 640, 480, 583.9147, 586.7294, 310.0020, 251.6837)
    rotation = rotation_matrix(Rotation.from_euler("xyz", [-0.4, -0.9, 0.6], degrees=True))
    return Rig(depth, color, rotation, [-0.030, 0.045, 0.020], optics)


def canvas_margin(rig, near_mm):
    """Margin (columns, rows) that the canvas needs for the depth camera to see surface everywhere, from near_mm on."""
    corners = np.array([[0, 0, 1], [rig.depth.width, 0, 1], [0, rig.depth.height, 1],
                        [rig.depth.width, rig.depth.height, 1]], float)
    rays = np.linalg.solve(rig.depth.K, corners.T)
    seen = np.concatenate([rig.color.K @ (rig.R @ (rays * z) + rig.t[:, None]) for z in (near_mm / 1000, 1e3)], axis=1)
    u, v = seen[0] / seen[2], seen[1] / seen[2]
    return (int(np.ceil(max(-u.min(), u.max() - rig.color.width, 0))) + 2,
            int(np.ceil(max(-v.min(), v.max() - rig.color.height, 0))) + 2)


# --- a photograph with a depth map -----------------------------------------------------------------------------------

def peel_layers(color, depth, step, reach):
    """Cut one view with a depth map into layers, back to front.

    color: H x W x 3 linear; depth: H x W mm; step: thickness of a layer in 1/mm; reach: how many pixels each layer
    goes on, with the colour of its nearest known pixel, behind whatever is nearer.
    """
    closeness = 1 / depth
    slab = np.floor((closeness - closeness.min()) / step).astype(np.int32)
    layers = []
    for value in np.unique(slab):
        own = slab == value
        distance, label = cv2.distanceTransformWithLabels((~own).astype(np.uint8), cv2.DIST_L2, 5,
                                                          labelType=cv2.DIST_LABEL_PIXEL)
        source = np.zeros(label.max() + 1, np.int64)
        source[label[own]] = np.flatnonzero(own)
        nearest = source[label]
        hidden = (slab > value) & (distance <= reach)
        filled = color.reshape(-1, 3)[nearest]
        filled = np.where(hidden[..., None], cv2.GaussianBlur(filled, (0, 0), 2), filled)
        layers.append(Layer(filled, (own | hidden).astype(np.float32), depth.reshape(-1)[nearest],
                            own + np.float32(INVENTED) * hidden))
    return layers


def motorcycle(size, optics, seed):
    """Middlebury's motorcycle as scikit-image ships it, 2.1 to 5 m; other sizes: scaled to cover, then cropped."""
    left, _, disparity = skimage.data.stereo_motorcycle()
    focal, cx, cy, doffs, baseline_mm = 994.978, 311.193, 254.877, 31.086, 193.001  # from its docstring
    known = np.isfinite(disparity) & (disparity > -doffs)
    depth = np.where(known, focal * baseline_mm / (np.where(known, disparity, 0) + doffs), 0)
    depth = fill_from_farther(depth).astype(np.float32)

    width, height = size
    scale = max(width / left.shape[1], height / left.shape[0])
    if scale != 1:
        full = (max(width, round(left.shape[1] * scale)), max(height, round(left.shape[0] * scale)))
        left = cv2.resize(left, full, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
        depth = cv2.resize(depth, full, interpolation=cv2.INTER_NEAREST)
    x, y = (left.shape[1] - width) // 2, (left.shape[0] - height) // 2
    left, depth = left[y:y + height, x:x + width], depth[y:y + height, x:x + width]
    color = Camera.pinhole("dslr", width, height, focal * scale, focal * scale,
                           (cx + 0.5) * scale - 0.5 - x, (cy + 0.5) * scale - 0.5 - y)
    rig = kinect_beside(color, optics)

    mx, my = margin = canvas_margin(rig, depth.min())
    left = cv2.copyMakeBorder(left, my, my, mx, mx, cv2.BORDER_REFLECT_101)
    depth = cv2.copyMakeBorder(depth, my, my, mx, mx, cv2.BORDER_REPLICATE)
    span = 1 / depth.min() - 1 / depth.max()
    widest = max(blur_circle_px(optics, color.K[0, 0], u, s)
                 for u, s in ((depth.min(), depth.max()), (depth.max(), depth.min())))
    layers = int(np.clip(np.ceil(widest / 0.75), 4, 24))  # 0.75 px of blur per layer where affordable
    step = span / layers * 1.0001  # a little more than a share, so that the nearest pixel falls into the last layer
    return Scene("motorcycle", rig, margin, peel_layers(srgb_to_linear(left), depth, step, widest + 2))


# --- surfaces built from planes --------------------------------------------------------------------------------------

@dataclass
class Plane:
    """A plane through `center`, turned by yaw and pitch (degrees) from facing the camera.

    shade: coordinates a (right), b (down) on the plane in metres -> (N x 3 linear colour, boolean mask of what exists).
    """
    center: Tuple[float, float, float]
    yaw: float
    pitch: float
    shade: Callable

    def layer(self, camera, margin, samples=3):
        """Render to a layer, samples x samples per pixel."""
        center = np.array(self.center)
        axes = rotation_matrix(Rotation.from_euler("YX", [self.yaw, self.pitch], degrees=True))  # columns: a, b, normal
        shape = (camera.height + 2 * margin[1], camera.width + 2 * margin[0])
        offsets = (np.arange(samples) + 0.5) / samples - 0.5

        def intersect(dx, dy, rows=slice(None), cols=slice(None)):
            """Depth (m) and position a, b on the plane where the rays meet it, and where they do at all."""
            x = (np.arange(shape[1], dtype=np.float32) + dx - margin[0] - camera.K[0, 2]) / camera.K[0, 0]
            y = (np.arange(shape[0], dtype=np.float32) + dy - margin[1] - camera.K[1, 2]) / camera.K[1, 1]
            along = [np.float32(x * e[0] + e[2])[None, cols] + np.float32(y * e[1])[rows, None] for e in axes.T]
            origin = np.float32(center @ axes)
            with np.errstate(divide="ignore", invalid="ignore"):
                z = origin[2] / along[2]
            ahead = (z > 0.1) & (z < 100)
            z = np.where(ahead, z, np.float32(100))
            return z, z * along[0] - origin[0], z * along[1] - origin[1], ahead

        z, a, b, ahead = intersect(0, 0)
        window = window_around(self.shade(a, b)[1] & ahead, pad=4)
        light, alpha = np.zeros(shape + (3,), np.float32), np.zeros(shape, np.float32)
        for dy in offsets:
            for dx in offsets:
                _, a, b, ahead = intersect(dx, dy, *window)
                color, exists = self.shade(a, b)
                exists = (exists & ahead).astype(np.float32)
                light[window] += color * exists[..., None]
                alpha[window] += exists
        light[window] /= np.maximum(alpha[window], 1)[..., None]
        alpha /= samples * samples
        z = np.clip(z, z[alpha > 0].min(), z[alpha > 0].max())
        return Layer(light, alpha, 1000 * z, alpha)


def picture(image, width, height):
    """Shade of a board width x height metres with an 8-bit picture on it."""
    image = srgb_to_linear(image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB))

    def shade(a, b):
        x, y = (a / width + 0.5) * image.shape[1] - 0.5, (b / height + 0.5) * image.shape[0] - 0.5
        color = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return color, (np.abs(a) <= width / 2) & (np.abs(b) <= height / 2)
    return shade


def tiles(image, width, tint, bottom):
    """Shade of a surface that ends at b = bottom and is tiled, mirrored, with a gray picture `width` metres wide."""
    image = srgb_to_linear(cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)) * np.float32(tint)

    def shade(a, b):
        scale = image.shape[1] / width
        color = cv2.remap(image, a * scale + image.shape[1] / 2, b * scale + image.shape[0] / 2, cv2.INTER_LINEAR,
                          borderMode=cv2.BORDER_REFLECT)
        return color, b <= bottom
    return shade


def plain(width, height, color):
    """Shade of a board without texture: one colour, a little darker towards its lower edge."""
    def shade(a, b):
        tone = 1 - 0.15 * (b / height + 0.5)
        return np.clip(tone, 0, 1)[..., None] * np.float32(color), (np.abs(a) <= width / 2) & (np.abs(b) <= height / 2)
    return shade


def rods(lines, radius, color_a, color_b, stripe):
    """Shade of thin straight rods, striped along their length; lines: (offset in metres, tilt in degrees)."""
    def shade(a, b):
        exists, along = np.full(a.shape, False), np.zeros(a.shape, np.float32)
        for offset, tilt in lines:
            c, s = np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
            here = np.abs((a - offset) * c + b * s) <= radius
            exists |= here
            along = np.where(here, b * c - (a - offset) * s, along)
        striped = (np.floor(along / stripe) % 2 == 0)[..., None]
        return np.where(striped, np.float32(color_a), np.float32(color_b)), exists
    return shade


def fence(columns, rows, mesh, bar, color_a, color_b):
    """Shade of a two-coloured grid of columns x rows meshes (even numbers); mesh and bar width in metres."""
    def shade(a, b):
        inside = (np.abs(a) <= (columns * mesh + bar) / 2) & (np.abs(b) <= (rows * mesh + bar) / 2)
        upright = np.abs((a + mesh / 2) % mesh - mesh / 2) <= bar / 2
        across = np.abs((b + mesh / 2) % mesh - mesh / 2) <= bar / 2
        checker = (np.floor(a / bar) + np.floor(b / bar)) % 2 == 0
        return np.where(checker[..., None], np.float32(color_a), np.float32(color_b)), inside & (upright | across)
    return shade


def planes(size, optics, seed):
    """A built scene, 0.8 to 4 m: wall, floor, slanted boards, a plain card, rods and a fence before them all."""
    width, height = size
    focal = 810.2 * width / 640
    color = Camera.pinhole("dslr", width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    rig = kinect_beside(color, optics)
    margin = canvas_margin(rig, 800)
    speckle = gaussian_filter(np.random.default_rng([seed, 0]).normal(size=(512, 512)), 1.5, mode="wrap")
    speckle = np.clip(128 + 40 * speckle / speckle.std(), 0, 255).astype(np.uint8)
    surfaces = [
        Plane((0.0, 0.5, 2.5), 0, 90, tiles(speckle, 0.9, (0.9, 0.8, 0.6), bottom=2.5)),
        Plane((0.0, 0.0, 3.75), 6, 0, tiles(skimage.data.brick(), 3.0, (1.0, 0.75, 0.6), bottom=0.5)),
        Plane((0.62, -0.45, 2.9), -12, 0, plain(0.8, 0.6, (0.55, 0.62, 0.45))),
        Plane((-0.42, -0.08, 2.2), 35, 0, picture(skimage.data.astronaut(), 0.8, 0.8)),
        Plane((0.33, -0.03, 1.55), -38, 5, picture(skimage.data.page(), 0.62, 0.31)),
        Plane((-0.02, 0.29, 1.3), 10, -40, picture(skimage.data.coffee(), 0.42, 0.28)),
        Plane((0.0, 0.0, 1.05), 0, 0, rods([(0.09, 6), (0.31, -9)], 0.006, (0.8, 0.1, 0.05), (0.85, 0.85, 0.8), 0.03)),
        Plane((-0.24, 0.10, 0.86), 18, 0, fence(8, 8, 0.048, 0.006, (0.05, 0.1, 0.06), (0.25, 0.5, 0.15))),
    ]
    return Scene("planes", rig, margin, [surface.layer(color, margin) for surface in surfaces])


@dataclass
class Preset:
    """A scene and what it is rendered with unless asked otherwise."""
    build: Callable
    size: Tuple[int, int]
    optics: Optics
    frames: int


SCENES = {
    "motorcycle": Preset(motorcycle, (741, 500), Optics(50.0, 1.8, 0.03), 12),
    "planes": Preset(planes, (640, 480), Optics(35.0, 2.8, 0.03), 12),
}
