# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A chessboard, and its inner corners in a picture."""
import re
from dataclasses import dataclass

import cv2
import numpy as np

MAX_SIDE = 1200  # pixels: the board is looked for in a picture of this size, its corners are then refined in the whole
MAGNIFIED_SIDE = 800  # a picture up to this size is also looked at magnified
MAX_WINDOW = 11  # pixels: half the window in which a corner is refined; in a larger one curved lines count
MAX_BEND = 0.15  # of a square: farther from a flat board's corners lies none, whatever the lens


@dataclass(frozen=True)
class Board:
    """Inner corners along and across the board, side of a square in m."""
    columns: int
    rows: int
    square: float

    @classmethod
    def parse(cls, text, square_mm):
        """From '8x6' and mm; the larger number counts the columns."""
        match = re.fullmatch(r"(\d+)x(\d+)", text.lower())
        sides = sorted(int(side) for side in match.groups()) if match else (0, 0)
        if sides[0] < 3:
            raise ValueError("'%s': expected the number of inner corners, as in 8x6; at least 3 each way" % text)
        return cls(sides[1], sides[0], square_mm / 1000)

    def __str__(self):
        return "%dx%d" % (self.columns, self.rows)

    @property
    def points(self):
        """Corners on the board, N x 3 in m, row by row."""
        y, x = np.mgrid[:self.rows, :self.columns]
        return np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3).astype(np.float32) * np.float32(self.square)

    def orders(self, corners):
        """The corners (N x 2) in every order that the board, which looks alike from two or four sides, may have."""
        grid = corners.reshape(self.rows, self.columns, 2)
        turns = range(4) if self.rows == self.columns else (0, 2)
        return [np.rot90(grid, turn).reshape(-1, 2) for turn in turns]

    def outline(self, corners):
        """The four outer ones of the corners, 4 x 2, around the board."""
        grid = corners.reshape(self.rows, self.columns, 2)
        return np.array([grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0]])


def gray(image):
    """Brightness 0 to 255, float32, of an 8- or 16-bit picture; 16 bits (infrared) are stretched to what is in use."""
    if image.ndim == 3:
        image = image[..., 0] if image.shape[2] == 1 else cv2.cvtColor(image[..., :3], cv2.COLOR_BGR2GRAY)
    if image.dtype == np.uint8:
        return image.astype(np.float32)
    return _stretched(image)


def _stretched(image):
    low, high = np.percentile(image, (0.5, 99.5))
    return np.clip((image.astype(np.float32) - np.float32(low)) * np.float32(255 / max(1, high - low)), 0, 255)


def find_corners(image, board, thorough=True):
    """Inner corners, N x 2 in pixels (centre of the first pixel: 0, 0), row by row; None where the board is not seen.

    thorough: what is not found quickly is looked for again, with more patience.
    """
    brightness = gray(image)
    side = max(brightness.shape)
    base = min(1, MAX_SIDE / side)
    for scale, flags in _searches(base, side) if thorough else [(base, 0)]:
        small = _scaled(brightness, scale)
        found, corners = cv2.findChessboardCornersSB(small, (board.columns, board.rows), flags=flags)
        if found:
            corners = (corners.reshape(-1, 2) + 0.5) / scale - 0.5
            return _refined(brightness, _not_mirrored(corners, board), board, scale)
    return None


def _searches(base, side):
    """(scale, flags), the quickest first. Small squares want magnifying; evening out the brightness of the whole
    picture helps a board in the shade, but lets noise rise beside a small one."""
    yield base, 0
    if side <= MAGNIFIED_SIDE:
        yield 2, 0
    yield base, cv2.CALIB_CB_NORMALIZE_IMAGE
    yield base, cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE


def _scaled(brightness, scale):
    """8 bit, stretched to the range in use."""
    if scale != 1:
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        brightness = cv2.resize(brightness, None, fx=scale, fy=scale, interpolation=way)
    return np.rint(_stretched(brightness)).astype(np.uint8)


def _not_mirrored(corners, board):
    """Rows that go right and columns that go down are right-handed, from whatever side the board is looked at."""
    grid = corners.reshape(board.rows, board.columns, 2)
    (ax, ay), (bx, by) = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    return (grid if ax * by - ay * bx > 0 else grid[:, ::-1]).reshape(-1, 2)


def _refined(brightness, corners, board, scale):
    """Corners to a fraction of a pixel, where the picture has them; None where they do not make a flat board.

    Those of findChessboardCornersSB are up to a pixel off on tilted boards.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    square = min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1))
    window = int(np.clip(0.4 * square, 2, max(MAX_WINDOW, np.ceil(4 / scale))))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
    start = np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(brightness, start, (window, window), (-1, -1), criteria).reshape(-1, 2)
    flat, _ = cv2.findHomography(board.points[:, :2], refined)
    if flat is None:
        return None
    bend = cv2.perspectiveTransform(board.points[None, :, :2], flat)[0] - refined
    return refined if np.linalg.norm(bend, axis=1).max() < max(1, MAX_BEND * square) else None
