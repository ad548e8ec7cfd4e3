# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Finds out from the pictures of a bracket whether the focus has moved."""
import cv2
import numpy as np

WIDTH = 1200  # pixels; wider pictures are shrunk, which averages their noise and saves time
SMOOTHING = 1.0  # pixels, standard deviation; against noise
TILES = (12, 8)  # columns, rows
DARK, BRIGHT = 12, 240  # grey levels; tiles with a mean beyond them are under- or overexposed
LEAST_TEXTURE = 0.01  # root mean square gradient per mean brightness; a tile with less shows mostly noise
LEAST_TILES = 4  # textured tiles, without which nothing can be said
LEAST_CHANGE = 0.2  # of the gradient energy: noise of 6 of 255 grey levels changes it by up to 0.17 over nine frames


class FocusCheck:
    """Compares the sharpness of the frames of a bracket, tile by tile. When the focus moves, parts of the picture become
    sharper or softer. When it stands still, only noise changes the sharpness."""

    def __init__(self):
        self._energies = []  # gradient energy of the tiles of each frame; NaN where it cannot be compared
        self._shape = None

    def add(self, image):
        """image: BGR, 8 bit; the next frame of the bracket."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        if grey.shape[1] > WIDTH:
            height = max(1, round(grey.shape[0] * WIDTH / grey.shape[1]))
            grey = cv2.resize(grey, (WIDTH, height), interpolation=cv2.INTER_AREA)
        if grey.shape != self._shape:  # only pictures of one size can be compared
            self._energies, self._shape = [], grey.shape
        self._energies.append(_gradient_energy(grey))

    @property
    def change(self):
        """Greatest relative change of the gradient energy in the bracket, 0 to 1: the 90th percentile of the textured
        tiles. None if there are fewer than two frames, or too few textured tiles."""
        if len(self._energies) < 2:
            return None
        energies = np.array(self._energies)
        textured = np.isfinite(energies).all(axis=0)
        textured[textured] = energies[:, textured].max(axis=0) > LEAST_TEXTURE ** 2
        if np.count_nonzero(textured) < LEAST_TILES:
            return None
        energies = energies[:, textured]
        return float(np.percentile(1 - energies.min(axis=0) / energies.max(axis=0), 90))

    @property
    def stood_still(self):
        """Whether the focus was the same in all frames, as far as can be seen."""
        return self.change is not None and self.change < LEAST_CHANGE


def _gradient_energy(grey):
    """Mean squared gradient of each tile, relative to its squared mean brightness: flicker does not change it."""
    grey = grey.astype(np.float32)
    mean = cv2.resize(grey, TILES, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(grey, (0, 0), SMOOTHING)
    x, y = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
    energy = cv2.resize(x * x + y * y, TILES, interpolation=cv2.INTER_AREA)
    return np.where((mean > DARK) & (mean < BRIGHT), energy / np.maximum(mean, 1) ** 2, np.nan)
