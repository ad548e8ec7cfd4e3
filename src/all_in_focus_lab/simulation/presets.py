# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The scenes of make_scene: functions (size, optics, seed) -> LayeredScene, listed in SCENES with their defaults.

Pictures on surfaces are those that scikit-image ships; none is downloaded. Lengths of built surfaces are in metres in
the colour camera's frame (X right, Y down, Z forward), layers go back to front.
"""
from typing import Callable, NamedTuple, Tuple

import numpy as np
import skimage.data
from scipy.ndimage import gaussian_filter

from all_in_focus.files.rig import Camera, Optics
from all_in_focus_lab.simulation.layered_scene import LayeredScene, canvas_margin, kinect_beside
from all_in_focus_lab.simulation.photograph import motorcycle
from all_in_focus_lab.simulation.surfaces import (Ball, Plane, disc, fence, leaves, lit, marked, picture, plain, rods,
                                                  shaded_under, tiles, twigs)


def _camera(size):
    """Colour camera of the built scenes: 43 degrees wide."""
    width, height = size
    focal = 810.2 * width / 640
    return Camera.pinhole("dslr", width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


def _built(name, size, optics, near_mm, surfaces):
    """Scene of surfaces, back to front, of which the nearest begins at near_mm."""
    color, seen_by_depth = _camera(size), None
    rig = kinect_beside(color, optics)
    margin = canvas_margin(rig, near_mm)
    finer = int(color.K[0, 0] / (2 * rig.depth.K[0, 0]))  # than the depth image needs, a factor
    if finer > 1:
        seen_by_depth = _built(name, (size[0] // finer, size[1] // finer), optics, near_mm, surfaces)
        margin = tuple(min(side, size[0] // 16) for side in margin)  # nothing farther outside reaches the picture
    return LayeredScene(name, rig, margin, [surface.layer(color, margin) for surface in surfaces], seen_by_depth, surfaces)


def _speckle(seed):
    """512 x 512 gray, seamless: blotches about 4 pixels wide."""
    noise = gaussian_filter(np.random.default_rng([seed, 0]).normal(size=(512, 512)), 1.5, mode="wrap")
    return np.clip(128 + 40 * noise / noise.std(), 0, 255).astype(np.uint8)


def planes(size, optics, seed):
    """0.8 to 4 m: wall, floor, slanted boards, a plain card, rods and a fence before them all."""
    return _built("planes", size, optics, 800, [
        Plane((0.0, 0.5, 2.5), 0, 90, tiles(_speckle(seed), 0.9, (0.9, 0.8, 0.6), bottom=2.5)),
        Plane((0.0, 0.0, 3.75), 6, 0, tiles(skimage.data.brick(), 3.0, (1.0, 0.75, 0.6), bottom=0.5)),
        Plane((0.62, -0.45, 2.9), -12, 0, plain(0.8, 0.6, (0.55, 0.62, 0.45))),
        Plane((-0.42, -0.08, 2.2), 35, 0, picture(skimage.data.astronaut(), 0.8, 0.8)),
        Plane((0.33, -0.03, 1.55), -38, 5, picture(skimage.data.page(), 0.62, 0.31)),
        Plane((-0.02, 0.29, 1.3), 10, -40, picture(skimage.data.coffee(), 0.42, 0.28)),
        Plane((0.0, 0.0, 1.05), 0, 0, rods([(0.09, 6), (0.31, -9)], 0.006, (0.8, 0.1, 0.05), (0.85, 0.85, 0.8), 0.03)),
        Plane((-0.24, 0.10, 0.86), 18, 0, fence(8, 8, 0.048, 0.006, (0.05, 0.1, 0.06), (0.25, 0.5, 0.15))),
    ])


def _branch_segments(rng, start, heading, length, radius, depth=0):
    """Rows for `twigs`: a crooked branch that starts at (a, b) towards heading (radians) and forks four times."""
    rows = []
    for _ in range(4):
        heading += rng.normal(0, 0.16)
        end = start + length / 4 * np.array([np.cos(heading), np.sin(heading)])
        rows.append((*start, *end, radius, 0.87 * radius))
        start, radius = end, 0.87 * radius
        if depth < 2:
            fork = heading + rng.choice([-1, 1]) * rng.uniform(0.5, 1.0)
            rows += _branch_segments(rng, start, fork, 0.5 * length, 0.6 * radius, depth + 1)
    return rows


def occluders(size, optics, seed):
    """0.8 to 3.4 m: twigs, rods and wire grids a few pixels wide at seven depths before a wall with pictures."""
    rng = np.random.default_rng([seed, 3])

    def branch(depth, yaw, start, heading, length, radius):
        segments = _branch_segments(rng, np.array(start), heading, length, radius)
        return Plane((0.0, 0.0, depth), yaw, 0, twigs(segments, (0.16, 0.10, 0.06)))

    return _built("occluders", size, optics, 800, [
        Plane((0.0, 0.0, 3.3), -5, 0, tiles(skimage.data.brick(), 1.3, (1.0, 0.72, 0.55))),
        Plane((-0.62, -0.3, 3.0), 8, 0, picture(skimage.data.chelsea(), 1.0, 0.67)),
        Plane((0.7, 0.35, 2.7), -14, 0, picture(skimage.data.text(), 1.2, 0.46)),
        Plane((0.35, -0.25, 2.3), 10, 0, fence(16, 10, 0.06, 0.006, (0.5, 0.52, 0.55), (0.12, 0.13, 0.15))),
        branch(1.9, -12, (-0.85, 0.35), -0.45, 1.5, 0.012),
        Plane((-0.25, 0.22, 1.55), -10, 0, fence(14, 8, 0.04, 0.003, (0.1, 0.3, 0.15), (0.4, 0.65, 0.3))),
        branch(1.3, 14, (0.6, 0.1), -2.75, 1.0, 0.008),
        Plane((0.0, 0.0, 1.1), 0, 0, rods([(-0.33, 4), (0.12, -3), (0.2, 2)], 0.003, (0.75, 0.6, 0.1),
                                          (0.08, 0.08, 0.1), 0.025)),
        branch(0.95, -8, (-0.1, -0.45), 1.2, 0.62, 0.005),
        Plane((0.0, 0.0, 0.84), 0, 0, rods([(0.31, 8)], 0.005, (0.6, 0.08, 0.06), (0.85, 0.85, 0.8), 0.03)),
    ])


def plain_surfaces(size, optics, _seed):
    """0.9 to 3.5 m: painted walls, floor, panels and balls in soft light, with few marks that show any focus."""
    dark, white = (0.05, 0.05, 0.06), (0.8, 0.8, 0.78)
    wall = marked(plain(6, 5, (0.62, 0.6, 0.52)),
                  [(-0.2, -0.55, 0.09, 0.13, white), (-0.2, -0.55, 0.03, 0.05, dark), (0.95, -0.9, 0.5, 0.012, dark),
                   (0, 0.47, 6, 0.06, (0.3, 0.2, 0.12))])
    panel = marked(plain(0.75, 1.6, (0.2, 0.33, 0.42)),
                   [(0.28, 0.1, 0.1, 0.022, (0.6, 0.55, 0.4)), (0, -0.42, 0.45, 0.006, dark),
                    (0, 0.45, 0.45, 0.006, dark)])
    box = marked(plain(0.5, 0.42, (0.55, 0.2, 0.12)), [(0.12, 0.1, 0.12, 0.05, white), (0.12, 0.1, 0.08, 0.008, dark)])
    card = marked(plain(0.26, 0.34, white), [(0.0, -0.1, 0.16, 0.007, dark), (-0.02, -0.07, 0.12, 0.007, dark)])
    floor = shaded_under(plain(8, 4, (0.4, 0.36, 0.3)), [(0.4, 0.8, 0.25), (-0.32, 0.5, 0.2), (-0.95, 1.7, 0.4)])
    return _built("plain", size, optics, 900, [
        Plane((0.0, 0.0, 3.5), 0, 0, lit(wall, -0.6, -0.9, 1.8)),
        Plane((0.0, 0.5, 1.5), 0, 90, lit(floor, -0.4, 0.4, 1.6)),
        Plane((-0.95, -0.3, 3.2), 9, 0, lit(panel, 0.2, -0.7, 1.5)),
        Plane((0.4, 0.29, 2.3), -24, 0, lit(box, -0.2, -0.3, 0.5)),
        Ball((-0.32, 0.3, 2.0), 0.2, plain(9, 9, (0.75, 0.55, 0.1))),
        Ball((0.27, -0.26, 1.7), 0.17, plain(9, 9, (0.28, 0.45, 0.22))),
        Plane((-0.33, -0.12, 1.25), 22, 0, lit(card, -0.1, -0.2, 0.4)),
        Plane((0.34, 0.2, 0.98), -15, 8, lit(plain(0.16, 0.22, (0.25, 0.3, 0.55)), -0.1, -0.1, 0.25)),
    ])


def slope(size, optics, seed):
    """0.8 to 4.5 m: gravel that runs away from under the camera, which looks down by 20 degrees; things stand on it."""
    tilt, height = np.radians(20), 0.5
    down, away = np.array([0, np.cos(tilt), np.sin(tilt)]), np.array([0, -np.sin(tilt), np.cos(tilt)])

    def above(right, forward, up):
        """Point over the ground, in the camera's frame."""
        return tuple(np.array([right, 0, 0]) + forward * away + (height - up) * down)

    def standing(right, forward, width, tall, yaw, image):
        return Plane(above(right, forward, tall / 2), yaw, 0, picture(image, width, tall), tilt=20)

    spots = [(-0.55, 2.25, 0.2), (0.3, 1.45, 0.11), (-0.22, 0.98, 0.065)]  # right, forward, radius
    shades = (tiles(skimage.data.gravel(), 0.5, (0.9, 0.5, 0.3)), tiles(_speckle(seed), 0.5, (0.95, 0.85, 0.4)),
              tiles(skimage.data.brick(), 0.25, (0.5, 0.7, 0.9)))
    balls = [Ball(above(*spot), spot[2], shade) for spot, shade in zip(spots, shades)]
    # The plane's b runs along `away`.
    ground = shaded_under(tiles(skimage.data.gravel(), 0.8, (0.85, 0.8, 0.7), bottom=4.6), spots)
    return _built("slope", size, optics, 750, [
        Plane(above(0, 4.6, 0), 0, 0, tiles(skimage.data.grass(), 1.4, (0.55, 0.85, 0.35), bottom=0.0), tilt=20),
        Plane(above(0, 0, 0), 0, 90, ground, tilt=20),
        standing(0.75, 3.4, 0.7, 0.7, -20, skimage.data.astronaut()),
        standing(-0.15, 2.75, 0.36, 0.5, 12, skimage.data.coins()),
        balls[0],
        standing(0.45, 1.95, 0.42, 0.28, -35, skimage.data.coffee()),
        balls[1],
        balls[2],
    ])


def garden(size, optics, seed):
    """0.8 to 4.5 m: bars, leaves, wires and hair before a bright sky with lamps, which are brighter than white."""
    rng = np.random.default_rng([seed, 6])
    sky = lit(plain(12, 9, (0.95, 0.98, 1.0)), -0.5, -1.5, 4, floor=0.6)
    lamps = [(rng.uniform(-1.6, 1.6), rng.uniform(-1.2, 0.4), 0.012, (8.0, 6.5, 4.0)) for _ in range(12)]
    glints = [(rng.uniform(-0.4, 0.4), rng.uniform(-0.1, 0.1), 0.0015, (6.0, 6.0, 6.0)) for _ in range(25)]

    def foliage(depth, count, length, low, tone):
        right, down = 1.1 * depth / 2, 0.8 * depth / 2
        rows = np.column_stack([rng.uniform(*ends, count) for ends in ((-right, right), (-down, down), (0, np.pi))])
        return Plane((0.0, 0.0, depth), *rng.uniform(-8, 8, 2), leaves(rows[rows[:, 1] > low * depth], length, tone))

    def hair(depth, a, b, count, length):
        strands = []
        for _ in range(count):
            strands += _branch_segments(rng, np.array([a + rng.normal(0, 0.02), b]), -np.pi / 2 + rng.normal(0, 0.5),
                                        length * rng.uniform(0.5, 1), 0.0009, depth=2)
        return Plane((0.0, 0.0, depth), 0, 0, twigs(strands, (0.25, 0.15, 0.07)))

    return _built("garden", size, optics, 780, [
        Plane((0.0, 0.0, 4.5), 0, 0, marked(sky, lamps)),
        Plane((0.0, 0.9, 4.2), 0, 0, tiles(skimage.data.grass(), 1.2, (0.45, 0.7, 0.25), top=0.0)),
        Plane((0.6, 0.1, 3.6), -20, 0, picture(skimage.data.text(), 1.3, 0.5)),
        foliage(3.0, 900, 0.07, -0.1, (0.16, 0.33, 0.08)),
        Plane((-0.35, -0.1, 2.4), 15, 0, rods([(x, 0) for x in np.arange(-0.5, 0.51, 0.07)], 0.012, (0.01, 0.01, 0.01),
                                              (0.012, 0.011, 0.01), 0.2)),
        foliage(1.9, 260, 0.06, -0.05, (0.2, 0.42, 0.1)),
        Plane((0.3, -0.12, 1.5), -15, 0, fence(12, 8, 0.04, 0.0016, (0.3, 0.3, 0.32), (0.5, 0.5, 0.5))),
        hair(1.2, -0.2, 0.45, 60, 0.5),
        Plane((0.12, 0.26, 1.05), 0, 0, marked(plain(0.3, 0.1, (0.05, 0.06, 0.1)), glints)),
        foliage(0.88, 40, 0.035, 0.12, (0.3, 0.5, 0.12)),
    ])


CARDS = 40
PICTURES = ("astronaut", "brick", "camera", "chelsea", "coffee", "coins", "grass", "gravel", "immunohistochemistry",
            "moon", "page", "retina", "rocket", "text")  # of skimage.data


def clutter(size, optics, seed):
    """0.8 to 3.7 m: cards and discs with pictures, at random depths before a brick wall, none through another."""
    rng = np.random.default_rng([seed, 4])
    color = _camera(size)
    rig = kinect_beside(color, optics)
    margin = canvas_margin(rig, 780)
    surfaces = [Plane((0.0, 0.0, 3.5), 4, 3, tiles(skimage.data.brick(), 2.2, (0.9, 0.8, 0.7)))]
    layers = [surfaces[0].layer(color, margin)]
    nearest = layers[0].depth.copy()
    half = np.array([color.width, color.height]) / 2 / color.K[0, 0]
    names = [name for _ in range(CARDS) for name in rng.permutation(PICTURES)]

    def card(z):
        image = getattr(skimage.data, names.pop())()
        width = rng.uniform(0.12, 0.24) * z
        height = width * image.shape[0] / image.shape[1]
        shade = picture(image, width, height)
        if rng.random() < 0.4:
            shade = disc(shade, min(width, height) / 2)
        yaw, pitch = rng.uniform(-40, 40, 2)
        return Plane((*(rng.uniform(-1, 1, 2) * half * z), z), yaw, pitch, shade)

    for z in 1 / np.linspace(1 / 3.2, 1 / 0.88, CARDS):
        for _ in PICTURES:  # tries
            surface = card(z)
            layer = surface.layer(color, margin)
            shown = layer.alpha > 0
            if (layer.depth[shown] < nearest[shown]).all():  # it cuts through no other
                nearest[shown] = layer.depth[shown]
                surfaces.append(surface)
                layers.append(layer)
                break
    return LayeredScene("clutter", rig, margin, layers, surfaces=surfaces)


class Preset(NamedTuple):
    """A scene with its default size and optics."""
    build: Callable
    size: Tuple[int, int]
    optics: Optics


SCENES = {
    "clutter": Preset(clutter, (640, 480), Optics(50.0, 2.8, 0.03)),
    "garden": Preset(garden, (640, 480), Optics(35.0, 2.8, 0.03)),
    "motorcycle": Preset(motorcycle, (741, 500), Optics(50.0, 1.8, 0.03)),
    "occluders": Preset(occluders, (640, 480), Optics(50.0, 2.8, 0.03)),
    "plain": Preset(plain_surfaces, (640, 480), Optics(35.0, 2.0, 0.03)),
    "planes": Preset(planes, (640, 480), Optics(35.0, 2.8, 0.03)),
    "slope": Preset(slope, (640, 480), Optics(50.0, 2.8, 0.03)),
}
