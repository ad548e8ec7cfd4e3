# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Many pictures on one sheet, each under its title."""
import os

import cv2
import numpy as np

from all_in_focus.files.stack import read_image

NO_FRAME = 65535  # in source_index images
TITLE_HEIGHT, MARGIN = 24, 6  # pixels
BACKGROUND, INK = 255, (40, 40, 40)


def split_title(text):
    """(path, title) of IMAGE or IMAGE:TITLE; without a title it is the file's name."""
    path, colon, title = text.rpartition(":")
    if not colon or os.path.exists(text):
        return text, os.path.basename(text)
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
    return picture(read_image(path, cv2.IMREAD_UNCHANGED), "source_index" not in os.path.basename(path))
