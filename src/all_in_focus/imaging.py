# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Image operations that several modules share: sRGB, filling of holes, sharpness, contact sheets.

Depth maps are H x W, 0 = unknown.
"""
from pathlib import Path

import cv2
import numpy as np

NO_FRAME = 65535  # in source_index images
TITLE_HEIGHT, MARGIN = 24, 6  # pixels
BACKGROUND, INK = 255, (40, 40, 40)
# Of FocusCheck and gradient_energy().
CHECKED_WIDTH = 1200  # pixels; wider pictures are shrunk, which averages their noise and saves time
SMOOTHING = 1.0  # pixels, standard deviation; against noise
TILES = (12, 8)  # columns, rows
DARK, BRIGHT = 12, 240  # grey levels; tiles with a mean beyond them are under- or overexposed
LEAST_TEXTURE = 0.01  # root mean square gradient per mean brightness; a tile with less shows mostly noise
LEAST_TILES = 4  # textured tiles, without which nothing can be said
LEAST_CHANGE = 0.2  # of the gradient energy: noise of 6 of 255 grey levels changes it by up to 0.17 over nine frames
FAR_HUE, LAST_FRAME_HUE = 120, 150  # blue, violet, in OpenCV's unit of two degrees; near and first are red


def srgb_to_linear(code):
    """8-bit sRGB values -> linear light 0..1 (float32)."""
    v = np.asarray(code, np.float32) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)


def linear_to_srgb(light):
    """Linear light 0..1 -> 8-bit sRGB values as float32, not yet rounded."""
    v = np.clip(light, 0, 1)
    return (255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)).astype(np.float32)


def white_code(highest):
    """The code of white in pictures of 16 bits whose highest code is that, as codes.hpp has it."""
    return next((2 ** bits - 1 for bits in (8, 10, 12, 14) if 0 < highest < 2 ** bits), 65535)


def fill_from_farther(depth):
    """Depth map with each hole filled along its row from the farther of its two sides; empty rows stay 0."""
    columns = np.arange(depth.shape[1])[None, :]
    known = depth > 0
    left = np.maximum.accumulate(np.where(known, columns, -1), axis=1)
    right = np.minimum.accumulate(np.where(known, columns, depth.shape[1])[:, ::-1], axis=1)[:, ::-1]
    padded = np.pad(depth, ((0, 0), (1, 1)))
    rows = np.arange(depth.shape[0])[:, None]
    return np.where(known, depth, np.maximum(padded[rows, left + 1], padded[rows, right + 1]))


def shrunk(image, width, interpolation=cv2.INTER_AREA):
    """The image, at most `width` pixels wide."""
    if image.shape[1] <= width:
        return image
    return cv2.resize(image, (width, max(1, round(image.shape[0] * width / image.shape[1]))), interpolation=interpolation)


def gradient_energy(brightness, tiles):
    """(mean squared gradient of each tile, relative to its squared mean brightness, so that flicker does not change it; mean
    brightness). brightness: H x W float32, 0..255; tiles: (columns, rows)."""
    smooth = cv2.GaussianBlur(brightness, (0, 0), SMOOTHING)
    x, y = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
    energy, mean = (cv2.resize(values, tiles, interpolation=cv2.INTER_AREA) for values in (x * x + y * y, brightness))
    return energy / np.maximum(mean, 1) ** 2, mean


class FocusCheck:
    """Compares the sharpness of the frames of a bracket, tile by tile. When the focus moves, parts of the picture become
    sharper or softer. When it stands still, only noise changes the sharpness."""

    def __init__(self):
        self._energies = []  # gradient energy of the tiles of each frame; NaN where it cannot be compared
        self._shape = None

    def add(self, image):
        """image: BGR, 0..255; the next frame of the bracket."""
        grey = shrunk(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), CHECKED_WIDTH)
        if grey.shape != self._shape:  # only pictures of one size can be compared
            self._energies, self._shape = [], grey.shape
        energy, mean = gradient_energy(np.float32(grey), TILES)
        self._energies.append(np.where((mean > DARK) & (mean < BRIGHT), energy, np.nan))

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


def split_title(text):
    """(path, title) of IMAGE or IMAGE:TITLE; without a title it is the file's name."""
    path, colon, title = text.rpartition(":")
    if not colon or Path(text).exists():
        return text, Path(text).name
    return path, title


def picture(image, zero_is_unknown=True):
    """What people can see: BGR, 8 bit. 16-bit images are coloured: depth and labels from red (near) to blue, with metres
    below the depth; a source index from red (the first frame) to violet.

    zero_is_unknown: 0 is drawn black, as in labels and depth; in a source index it is the first frame.
    """
    if image.dtype == np.uint16 and image.ndim == 2:
        if not zero_is_unknown:
            known = image[image != NO_FRAME]
            return index_picture(image, int(known.max()) + 1 if known.size else 1)
        return _region_picture(image) if _are_labels(image) else depth_picture(image)
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.ndim == 2:
        return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    return cv2.cvtColor(image, cv2.COLOR_BGRA2BGR) if image.shape[2] == 4 else image


def _are_labels(image):
    """Labels are numbered without a gap from 1 on; depths in mm are not."""
    known = np.unique(image[image > 0])
    return bool(known.size) and known[-1] == known.size


def hues(count, last=FAR_HUE, alternate=False):
    """count x 3 BGR, from red to the hue `last`, as src/core/drawing.cpp has them; alternate: every other is darker."""
    hsv = np.full((1, max(count, 1), 3), (0, 220, 255), np.uint8)
    hsv[0, :, 0] = np.rint(np.linspace(0, last, max(count, 1)))
    if alternate:
        hsv[0, 1::2, 2] = 180
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)[0]


def depth_picture(depth):
    """Depth (H x W uint16 mm, 0 = unknown) as BGR, from red (nearest) to blue (farthest), evenly in dioptres, unknown
    black; below it a legend with metres."""
    known = depth[depth > 0]
    if not known.size:
        return np.zeros(depth.shape + (3,), np.uint8)
    near, far = float(known.min()), float(known.max())
    colours = hues(256)

    def colour(millimetres):
        share = (1 / near - 1 / np.maximum(millimetres, 1.0)) / max(1e-12, 1 / near - 1 / far)
        return colours[np.rint(np.clip(share, 0, 1) * 255).astype(int)]
    shown = colour(np.arange(65536))
    shown[0] = 0
    return np.vstack([shown[depth], _legend(depth.shape[1], near, far, colour)])


def _region_picture(labels):
    """Labels (H x W, 0 = unknown, 1.. near to far) as BGR, from red (near) to blue; every other is darker."""
    return np.vstack([np.zeros((1, 3), np.uint8), hues(int(labels.max()), alternate=True)])[labels]


def index_picture(index, frames):
    """Which frame won (H x W uint16) as BGR, from red (the first of `frames`) to violet; NO_FRAME is black."""
    shown = hues(frames, LAST_FRAME_HUE)[np.minimum(index, frames - 1)]
    shown[index == NO_FRAME] = 0
    return shown


def _legend(width, near, far, colour):
    """Strip of colours from near to far (mm), evenly in dioptres, with metres below; colour: of an array of mm."""
    scale, line, bar = max(0.3, width / 1100), max(1, round(width / 900)), max(6, width // 40)
    gap = max(2, bar // 4)

    def size(text):
        return cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, line)[0]
    strip = np.full((bar + size("0")[1] + 3 * gap, width, 3), BACKGROUND, np.uint8)
    strip[gap:gap + bar] = colour(1 / np.interp((np.arange(width) + 0.5) / width, [0, 1], [1 / near, 1 / far]))
    ticks = 1 if near == far else min(5, max(2, width // (2 * size("8.88 m")[0])))
    for share in np.linspace(0, 1, ticks):
        text = f"{1 / (1 / near + share * (1 / far - 1 / near)) / 1000:.3g} m"
        cv2.putText(strip, text, (round(share * (width - size(text)[0])), strip.shape[0] - gap), cv2.FONT_HERSHEY_SIMPLEX,
                    scale, INK, line, cv2.LINE_AA)
    return strip


def with_lines(image, lines):
    size = max(1.0, image.shape[1] / 1000)
    step = round(TITLE_HEIGHT * size)
    text = np.zeros((step * len(lines) + 8, image.shape[1], 3), np.uint8)
    for number, line in enumerate(lines):
        width = cv2.getTextSize(line, cv2.FONT_HERSHEY_SIMPLEX, 0.5 * size, 1)[0][0]
        fitted = 0.5 * size * min(1, (image.shape[1] - 12) / max(1, width))
        cv2.putText(text, line, (6, step * (number + 1) - 6), cv2.FONT_HERSHEY_SIMPLEX, fitted, (230, 230, 230),
                    max(1, round(size)), cv2.LINE_AA)
    return np.vstack([image, text])


def _tile(image, title, width):
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    shrink = width < image.shape[1]
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA if shrink else cv2.INTER_NEAREST)
    tile = cv2.copyMakeBorder(small, TITLE_HEIGHT, 0, 0, 0, cv2.BORDER_CONSTANT, value=(BACKGROUND,) * 3)
    cv2.putText(tile, title, (2, TITLE_HEIGHT - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    return tile


def contact_sheet(images, titles, columns, width):
    """BGR sheet. images: BGR, 8 bit; columns: pictures in a row; width: of one picture, pixels."""
    tiles = [_tile(image, title, width) for image, title in zip(images, titles)]
    columns = min(columns, len(tiles))
    rows = []
    for begin in range(0, len(tiles), columns):
        row = tiles[begin:begin + columns]
        size = (max(tile.shape[0] for tile in row) + MARGIN, columns * (width + MARGIN), 3)
        rows.append(np.full(size, BACKGROUND, np.uint8))
        for column, tile in enumerate(row):
            left = column * (width + MARGIN)
            rows[-1][:tile.shape[0], left:left + width] = tile
    return cv2.copyMakeBorder(np.vstack(rows), MARGIN, 0, MARGIN, 0, cv2.BORDER_CONSTANT, value=(BACKGROUND,) * 3)
