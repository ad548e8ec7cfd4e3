# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A scene made of layers, with the rig of colour and depth camera that looks at it."""
from dataclasses import dataclass
from typing import List, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from all_in_focus.simulation.lens import Layer, composite, visible_depth
from all_in_focus.files.rig import Camera, Rig, rotation_matrix


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
