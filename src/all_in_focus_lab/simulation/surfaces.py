# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Surfaces of built scenes: planes and balls, and the shades that paint them.

Lengths are in metres in the colour camera's frame (X right, Y down, Z forward). A shade maps coordinates a (right),
b (down) on a surface (arrays of one shape, metres) to N x 3 linear colour and a boolean mask of what exists there.
"""
from dataclasses import dataclass
from itertools import product
from typing import Callable, Tuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from all_in_focus.files.rig import rotation_matrix
from all_in_focus.imaging import srgb_to_linear
from all_in_focus_lab.simulation.lens import Layer, tiles_of, window_around

NEAR, FAR = 0.1, 100.0           # metres; surfaces end there
LIGHT = (-0.45, -0.75, -0.485)   # unit vector to the lamp: up, to the left, behind the camera
AMBIENT = 0.4                    # share of the light that comes from everywhere
SAMPLES = 3                      # rays along each side of a pixel
TILE_PX = 128                    # side of a tile; a shade of many small things tests only those near it


class Surface:
    """A surface that each ray meets at most once.

    A subclass says where: meet(x, y) of rays (x, y, 1), x: columns, y: rows, returns z (rows x columns, metres, finite
    also where the surface is missed), colour and mask of what exists.
    """

    def layer(self, camera, margin):
        """Render to a layer."""
        shape = (camera.height + 2 * margin[1], camera.width + 2 * margin[0])
        offsets = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5

        def meet(dx, dy, rows=slice(None), cols=slice(None)):
            x = (np.arange(shape[1], dtype=np.float32) + dx - margin[0] - camera.K[0, 2]) / camera.K[0, 0]
            y = (np.arange(shape[0], dtype=np.float32) + dy - margin[1] - camera.K[1, 2]) / camera.K[1, 1]
            return self.meet(x[cols], y[rows])

        z, exists = np.empty(shape, np.float32), np.empty(shape, bool)
        for tile in tiles_of((slice(0, shape[0]), slice(0, shape[1])), TILE_PX):
            z[tile], _, exists[tile] = meet(0, 0, *tile)
        window = window_around(exists, pad=4)
        if window is None:
            raise ValueError("a surface lies outside the picture")
        light, alpha = np.zeros(shape + (3,), np.float32), np.zeros(shape, np.float32)
        for tile in tiles_of(window, TILE_PX):
            for dy, dx in product(offsets, offsets):
                _, color, exists = meet(dx, dy, *tile)
                light[tile] += color * exists[..., None]
                alpha[tile] += exists
            light[tile] /= np.maximum(alpha[tile], 1)[..., None]
        alpha /= SAMPLES * SAMPLES
        shown = z[window][alpha[window] > 0]
        np.clip(z, shown.min(), shown.max(), out=z)
        z *= 1000
        return Layer(light, alpha, z, alpha)


@dataclass
class Plane(Surface):
    """A plane through `center`, rotated by yaw and pitch (degrees) from facing the camera; tilt: that of the ground
    it stands on, as seen by a camera that looks down by so many degrees."""
    center: Tuple[float, float, float]
    yaw: float
    pitch: float
    shade: Callable
    tilt: float = 0.0

    def meet(self, x, y):
        axes = rotation_matrix(Rotation.from_euler("XYX", [self.tilt, self.yaw, self.pitch], degrees=True))
        along = [np.float32(x * e[0] + e[2])[None, :] + np.float32(y * e[1])[:, None] for e in axes.T]  # a, b, normal
        origin = np.float32(np.array(self.center) @ axes)
        with np.errstate(divide="ignore", invalid="ignore"):
            z = origin[2] / along[2]
        ahead = (z > NEAR) & (z < FAR)
        z = np.where(ahead, z, np.float32(FAR))
        color, exists = self.shade(z * along[0] - origin[0], z * along[1] - origin[1])
        return z, color, exists & ahead


@dataclass
class Ball(Surface):
    """A ball in the light of a lamp; its shade's a and b are arc lengths from the point that faces the camera."""
    center: Tuple[float, float, float]
    radius: float
    shade: Callable

    def meet(self, x, y):
        center = np.float32(self.center)
        square = (x * x)[None, :] + (y * y)[:, None] + 1
        middle = (x * center[0] + center[2])[None, :] + (y * center[1])[:, None]
        root = middle * middle - square * (center @ center - np.float32(self.radius) ** 2)
        z = (middle - np.sqrt(np.maximum(root, 0))) / square  # beside the ball: where the ray comes nearest to it
        normal = [(ray * z - c) / self.radius for ray, c in zip((x[None, :], y[:, None], np.float32(1)), center)]
        lambert = np.maximum(sum(n * np.float32(e) for n, e in zip(normal, LIGHT)), 0)
        color, exists = self.shade(self.radius * np.arctan2(normal[0], -normal[2]),
                                   self.radius * np.arcsin(np.clip(normal[1], -1, 1)))
        return z, color * np.float32(AMBIENT + (1 - AMBIENT) * lambert)[..., None], exists & (root >= 0)


# --- shades -----------------------------------------------------------------------------------------------------------

def linear_rgb(image):
    """8-bit gray or RGB picture -> H x W x 3 linear light."""
    return srgb_to_linear(image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB))


def within(a, b, *size):
    """Mask of a shape about the origin; size: width and height of a rectangle, or the radius of a disc."""
    if len(size) == 1:
        return a * a + b * b <= size[0] * size[0]
    return (np.abs(a) <= size[0] / 2) & (np.abs(b) <= size[1] / 2)


def picture(image, width, height):
    """A board width x height metres with an 8-bit picture on it."""
    image = linear_rgb(image)

    def shade(a, b):
        x, y = (a / width + 0.5) * image.shape[1] - 0.5, (b / height + 0.5) * image.shape[0] - 0.5
        color = cv2.remap(image, np.float32(x), np.float32(y), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return color, within(a, b, width, height)
    return shade


def tiles(image, width, tint, bottom=np.inf, top=-np.inf):
    """A surface between b = top and bottom, tiled, mirrored, with a gray picture `width` metres wide."""
    image = linear_rgb(image) * np.float32(tint)

    def shade(a, b):
        scale = image.shape[1] / width
        color = cv2.remap(image, np.float32(a * scale + image.shape[1] / 2), np.float32(b * scale + image.shape[0] / 2),
                          cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        return color, (b <= bottom) & (b >= top)
    return shade


def plain(width, height, color):
    """A board without texture: one colour, a little darker towards its lower edge."""
    def shade(a, b):
        tone = 1 - 0.15 * (b / height + 0.5)
        return np.clip(tone, 0, 1)[..., None] * np.float32(color), within(a, b, width, height)
    return shade


def disc(shade, radius):
    """What another shade paints, cut to a disc."""
    def cut(a, b):
        color, exists = shade(a, b)
        return color, exists & within(a, b, radius)
    return cut


def marked(shade, marks):
    """What another shade paints, with rectangles on it, (a, b, width, height, linear colour), or discs: (a, b, radius,
    linear colour)."""
    def paint(a, b):
        color, exists = shade(a, b)
        for right, down, *size, ink in marks:
            color[within(a - right, b - down, *size)] = ink
        return color, exists
    return paint


def lit(shade, a0, b0, reach, floor=0.25):
    """What another shade paints, in the light of a lamp that is nearest to (a0, b0) and falls off over reach metres."""
    def paint(a, b):
        color, exists = shade(a, b)
        fall = floor + (1 - floor) / (1 + ((a - a0) ** 2 + (b - b0) ** 2) / reach ** 2) ** 1.5
        return color * np.float32(fall)[..., None], exists
    return paint


def shaded_under(shade, spots):
    """What another shade paints, with the soft contact shadows of things that stand on it: (a, b, radius)."""
    def paint(a, b):
        color, exists = shade(a, b)
        tone = np.ones(a.shape, np.float32)
        for right, away, radius in spots:
            tone *= 1 - 0.65 * np.exp(-((a - right) ** 2 + (b - away) ** 2) / (2 * (0.7 * radius) ** 2))
        return color * tone[..., None], exists
    return paint


def rows_within(rows, a, b, reach):
    """Those rows whose place (a, b), their first two columns, lies within reach of a tile of pixels."""
    return rows[(rows[:, 0] >= a.min() - reach) & (rows[:, 0] <= a.max() + reach)
                & (rows[:, 1] >= b.min() - reach) & (rows[:, 1] <= b.max() + reach)]


def leaves(rows, length, tone):
    """Pointed leaves with a light midrib: rows (a, b, angle in radians) of their middles; length in metres."""
    def shade(a, b):
        exists, color = np.full(a.shape, False), np.zeros(a.shape + (3,), np.float32)
        for right, down, angle in rows_within(np.float32(rows), a, b, length):
            near = np.nonzero((np.abs(a - right) <= length / 2) & (np.abs(b - down) <= length / 2))
            c, s, x, y = np.cos(angle), np.sin(angle), a[near] - right, b[near] - down
            along, across = (x * c + y * s) / (length / 2), np.abs(y * c - x * s) / (length / 6)
            here = (np.abs(along) <= 1) & (across <= 1 - along * along)
            bright = np.where(across < 0.08, 1.5, 0.7 + 0.5 * np.abs(np.sin(3 * angle)) - 0.25 * across)
            near = tuple(index[here] for index in near)
            exists[near], color[near] = True, bright[here][:, None] * np.float32(tone)
        return color, exists
    return shade


def rods(lines, radius, color_a, color_b, stripe):
    """Thin straight rods, striped along their length; lines: (offset in metres, tilt in degrees)."""
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


def twigs(segments, bark):
    """Branches of linear colour bark, lighter on their upper left: rows (a0, b0, a1, b1, radius at 0, radius at 1)."""
    rows = np.float32(segments)

    def shade(a, b):
        exists, tone = np.full(a.shape, False), np.zeros(a.shape, np.float32)
        longest = np.abs(rows[:, 2:4] - rows[:, :2]).max() + 2 * rows[:, 4:].max()
        for a0, b0, a1, b1, r0, r1 in rows_within(rows, a, b, longest):
            da, db, widest = a1 - a0, b1 - b0, max(r0, r1)
            near = (np.abs(2 * a - a0 - a1) <= abs(da) + 2 * widest) & (np.abs(2 * b - b0 - b1) <= abs(db) + 2 * widest)
            right, down = a[near] - a0, b[near] - b0
            along = np.clip((right * da + down * db) / (da * da + db * db), 0, 1)
            right, down, radius = right - along * da, down - along * db, r0 + along * (r1 - r0)
            here = right * right + down * down <= radius * radius
            rings = 0.25 * np.sin(along * np.hypot(da, db) * 900)  # nodes of the bark, 7 mm apart
            tone[near] = np.where(here, 1 - 0.4 * (right + down) / radius + rings, tone[near])
            exists[near] |= here
        return tone[..., None] * np.float32(bark), exists
    return shade


def fence(columns, rows, mesh, bar, color_a, color_b):
    """A two-coloured grid of columns x rows meshes (even numbers); mesh and bar width in metres."""
    def shade(a, b):
        inside = within(a, b, columns * mesh + bar, rows * mesh + bar)
        upright = np.abs((a + mesh / 2) % mesh - mesh / 2) <= bar / 2
        across = np.abs((b + mesh / 2) % mesh - mesh / 2) <= bar / 2
        checker = (np.floor(a / bar) + np.floor(b / bar)) % 2 == 0
        return np.where(checker[..., None], np.float32(color_a), np.float32(color_b)), inside & (upright | across)
    return shade
