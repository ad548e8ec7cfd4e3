# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Image operations that several rooms share: gray values, sRGB, filling of holes, contact sheets.

Depth maps are H x W, 0 = unknown.
"""
from pathlib import Path

import cv2
import numpy as np

from all_in_focus.files.stack import read_image

GRAY_OF_BGR = (0.114021, 0.587043, 0.298936)  # as Matlab's rgb2gray; cvtColor's differ by 1 in some pixels
NO_FRAME = 65535  # in source_index images
TITLE_HEIGHT, MARGIN = 24, 6  # pixels
BACKGROUND, INK = 255, (40, 40, 40)


def to_gray(image):
    """H x W uint8 of H x W (as it is) or H x W x 3 (BGR) uint8; ValueError for anything else."""
    image = np.asarray(image)
    if image.dtype != np.uint8 or not (image.ndim == 2 or image.ndim == 3 and image.shape[2] == 3):
        raise ValueError(f"expected an 8-bit image with one or three channels, not {image.dtype} of shape "
                         f"{image.shape}")
    return image if image.ndim == 2 else np.floor(image @ np.array(GRAY_OF_BGR) + 0.5).astype(np.uint8)


def srgb_to_linear(code):
    """8-bit sRGB values -> linear light 0..1 (float32)."""
    v = np.asarray(code, np.float32) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)


def linear_to_srgb(light):
    """Linear light 0..1 -> 8-bit sRGB values as float32, not yet rounded."""
    v = np.clip(light, 0, 1)
    return (255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)).astype(np.float32)


def fill_from_farther(depth):
    """Depth map with each hole filled along its row from the farther of its two sides; empty rows stay 0."""
    columns = np.arange(depth.shape[1])[None, :]
    known = depth > 0
    left = np.maximum.accumulate(np.where(known, columns, -1), axis=1)
    right = np.minimum.accumulate(np.where(known, columns, depth.shape[1])[:, ::-1], axis=1)[:, ::-1]
    padded = np.pad(depth, ((0, 0), (1, 1)))
    rows = np.arange(depth.shape[0])[:, None]
    return np.where(known, depth, np.maximum(padded[rows, left + 1], padded[rows, right + 1]))


def split_title(text):
    """(path, title) of IMAGE or IMAGE:TITLE; without a title it is the file's name."""
    path, colon, title = text.rpartition(":")
    if not colon or Path(text).exists():
        return text, Path(text).name
    return path, title


def picture(image, zero_is_unknown=True):
    """What people can see: BGR, 8 bit. 16-bit images (labels, source index, depth) are coloured over their range.

    zero_is_unknown: 0 is drawn black, as in labels and depth; in a source index it is the first frame.
    """
    if image.dtype == np.uint16 and image.ndim == 2:
        return _coloured(image, (image != NO_FRAME) & (image >= (1 if zero_is_unknown else 0)))
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.ndim == 2:
        return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    return cv2.cvtColor(image, cv2.COLOR_BGRA2BGR) if image.shape[2] == 4 else image


def _coloured(image, valid):
    low, high = (image[valid].min(), image[valid].max()) if valid.any() else (0, 1)
    scaled = (image.astype(np.float32) - low) * (255.0 / max(1, int(high) - int(low)))
    colours = cv2.applyColorMap(np.clip(scaled, 0, 255).astype(np.uint8), cv2.COLORMAP_TURBO)
    colours[~valid] = 0
    return colours


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
    rows = [tiles[i:i + columns] for i in range(0, len(tiles), columns)]
    columns = min(columns, len(tiles))
    heights = [max(tile.shape[0] for tile in row) for row in rows]
    size = (sum(heights) + MARGIN * (len(rows) + 1), columns * (width + MARGIN) + MARGIN, 3)
    sheet = np.full(size, BACKGROUND, np.uint8)
    top = MARGIN
    for row, height in zip(rows, heights):
        for column, tile in enumerate(row):
            left = MARGIN + column * (width + MARGIN)
            sheet[top:top + tile.shape[0], left:left + width] = tile
        top += height + MARGIN
    return sheet


def read_picture(path):
    """Picture of an image file; StackError where it cannot be read. A source index is known by its file name."""
    return picture(read_image(path, cv2.IMREAD_UNCHANGED), "source_index" not in Path(path).name)
