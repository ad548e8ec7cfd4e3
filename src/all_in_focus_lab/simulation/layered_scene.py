# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A scene made of layers, with the rig of colour and depth camera that looks at it."""
from dataclasses import dataclass, replace
from typing import List, Optional, Tuple

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from all_in_focus.files.rig import Camera, Rig, rotation_matrix
from all_in_focus_lab.simulation.lens import TILE_PX, Layer, composite, tiles_of

GRAIN_TILE = 1024                 # pixels; the texture repeats after so many
GRAIN_SIGMAS_PX = (0.7, 2, 6)     # texture of three sizes
PATCH_SIGMA_PX = 40


@dataclass
class LayeredScene:
    """Layers back to front on a canvas that exceeds the colour picture by margin = (columns, rows) on each side.

    seen_by_depth: the same surfaces on a wider and coarser canvas, from which the depth image is made; None: this
    scene is used. surfaces: what the layers were rendered from (see surfaces.py); none in a photograph.
    """
    name: str
    rig: Rig
    margin: Tuple[int, int]
    layers: List[Layer]
    seen_by_depth: Optional["LayeredScene"] = None
    surfaces: Tuple = ()

    def frame_window(self, pad):
        """The colour picture on the canvas, widened by pad pixels where the canvas allows (two slices)."""
        return (slice(max(0, self.margin[1] - pad), self.margin[1] + self.rig.color.height + pad),
                slice(max(0, self.margin[0] - pad), self.margin[0] + self.rig.color.width + pad))

    def seen_from(self, place_mm):
        """The scene from a camera that was moved to (right, down, ahead) without being turned."""
        if not np.any(place_mm):
            return self
        if not self.surfaces:
            raise ValueError("only a scene that is built of surfaces can be seen from another place")
        moved = [replace(it, center=tuple(np.array(it.center) - np.array(place_mm) / 1000)) for it in self.surfaces]
        return replace(self, layers=[surface.layer(self.rig.color, self.margin) for surface in moved], surfaces=moved)

    def _picture(self):
        window = self.frame_window(0)
        return [layer.crop(*window) for layer in self.layers]

    def truth(self):
        """The all-in-focus picture, linear light, cut at 1: lamps are brighter than a picture can show."""
        return np.minimum(composite(self._picture()), 1)

    def truth_depth(self):
        """True depth (mm) in the colour camera: of the nearest layer that covers at least half of a pixel."""
        depth = np.float32(0)
        for layer in self._picture():
            depth = np.where(layer.alpha >= 0.5, layer.depth, depth)
        return depth


def kinect_beside(color, optics):
    """Rig of a Kinect next to the colour camera, rotated by a few degrees."""
    depth = Camera.pinhole("kinect_depth", 640, 480, 583.9147, 586.7294, 310.0020, 251.6837)
    rotation = rotation_matrix(Rotation.from_euler("xyz", [-0.4, -0.9, 0.6], degrees=True))
    return Rig(depth, color, rotation, [-0.030, 0.045, 0.020], optics)


def canvas_margin(rig, near_mm):
    """Margin (columns, rows) that the canvas needs for the depth camera to see surface everywhere, from near_mm on."""
    corners = [(u, v, 1) for u in (0, rig.depth.width) for v in (0, rig.depth.height)]
    rays = np.linalg.solve(rig.depth.K, np.transpose(corners))
    seen = np.concatenate([rig.color.K @ (rig.R @ (rays * z) + rig.t[:, None]) for z in (near_mm / 1000, 1e3)], axis=1)
    u, v = seen[0] / seen[2], seen[1] / seen[2]
    return (int(np.ceil(max(-u.min(), u.max() - rig.color.width, 0))) + 2,
            int(np.ceil(max(-v.min(), v.max() - rig.color.height, 0))) + 2)


def add_grain(scene, deviation, seed):
    """Adds texture as fine as one pixel to every layer, which enlarged pictures on surfaces lack.

    deviation: standard deviation as a share of the light, where the texture is strongest. It comes in patches; between
    them the surfaces stay smooth.
    """
    rng = np.random.default_rng([seed, 5])
    grain = sum(_seamless(rng, sigma) for sigma in GRAIN_SIGMAS_PX) / np.sqrt(len(GRAIN_SIGMAS_PX))
    grain *= deviation * np.clip(_seamless(rng, PATCH_SIGMA_PX) + 0.5, 0, 1)
    for layer in scene.layers:
        rows, cols = (rng.integers(GRAIN_TILE) + np.arange(count) for count in layer.alpha.shape)
        for tile in tiles_of((slice(0, len(rows)), slice(0, len(cols))), TILE_PX):
            if layer.alpha[tile].any():
                factor = grain[np.ix_(rows[tile[0]] % GRAIN_TILE, cols[tile[1]] % GRAIN_TILE)]
                layer.color[tile] *= np.maximum(1 + factor, 0)[..., None]


def _seamless(rng, sigma):
    """Periodic noise of standard deviation 1, smoothed over sigma pixels."""
    noise = gaussian_filter(np.float32(rng.normal(size=(GRAIN_TILE, GRAIN_TILE))), sigma, mode="wrap")
    return noise / noise.std()
