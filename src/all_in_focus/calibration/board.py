# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A chessboard, its inner corners in a picture, and pairs of pictures of it by two cameras."""
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Optional

import cv2
import numpy as np

from all_in_focus.files.stack import StackError, is_image_name, read_image

CAMERAS = ("depth", "color")
MAX_SIDE = 1200  # pixels: larger pictures are searched at this size; corners are then refined at the full size
MAGNIFIED_SIDE = 800  # pixels: pictures up to this size are also searched at twice their size
MAX_WINDOW = 11  # pixels: half the window in which a corner is refined; in larger ones the bend of lines disturbs
MAX_BEND = 0.15  # of a square: corners of a flat board deviate less from a grid, whatever the lens


@dataclass(frozen=True)
class Board:
    """Inner corners along and across the board, side of a square in m."""
    columns: int
    rows: int
    square: float

    @classmethod
    def parse(cls, text, square_mm):
        """From '8x6' and mm; the larger number is that of the columns."""
        match = re.fullmatch(r"(\d+)x(\d+)", text.lower())
        sides = sorted(int(side) for side in match.groups()) if match else (0, 0)
        if sides[0] < 3:
            raise ValueError(f"'{text}': expected the number of inner corners, as in 8x6; at least 3 each way")
        return cls(sides[1], sides[0], square_mm / 1000)

    def __str__(self):
        return f"{self.columns}x{self.rows}"

    @property
    def points(self):
        """Corners on the board, N x 3 in m, row by row."""
        y, x = np.mgrid[:self.rows, :self.columns]
        return np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3).astype(np.float32) * np.float32(self.square)

    def orders(self, corners):
        """The corners (N x 2) in every possible order: the board looks alike from two or four sides."""
        grid = corners.reshape(self.rows, self.columns, 2)
        quarters = range(4) if self.rows == self.columns else (0, 2)
        return [np.rot90(grid, quarter).reshape(-1, 2) for quarter in quarters]

    def outline(self, corners):
        """The outermost four of the corners, 4 x 2, around the board."""
        grid = corners.reshape(self.rows, self.columns, 2)
        return np.array([grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0]])


def gray(image):
    """Brightness 0 to 255, float32, of an 8- or 16-bit picture; 16 bits (infrared) are stretched to their range."""
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

    thorough: whether to try slower searches where the quick one finds nothing.
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
    """(scale, flags), the quickest first. Small squares are found in a magnified picture. Equalising the brightness
    finds a board in the shade, but amplifies noise around a small one, so it comes later."""
    yield base, 0
    if side <= MAGNIFIED_SIDE:
        yield 2, 0
    yield base, cv2.CALIB_CB_NORMALIZE_IMAGE
    yield base, cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE


def _scaled(brightness, scale):
    """Picture at another scale, 8 bit, stretched to the range in use."""
    if scale != 1:
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        brightness = cv2.resize(brightness, None, fx=scale, fy=scale, interpolation=way)
    return np.rint(_stretched(brightness)).astype(np.uint8)


def _not_mirrored(corners, board):
    """Corners in an order that is not mirrored: rows to the right and columns down make a right-handed grid."""
    grid = corners.reshape(board.rows, board.columns, 2)
    (ax, ay), (bx, by) = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    return (grid if ax * by - ay * bx > 0 else grid[:, ::-1]).reshape(-1, 2)


def _refined(brightness, corners, board, scale):
    """Corners refined in the full picture; None where they do not lie on a flat board.

    findChessboardCornersSB is up to a pixel off on tilted boards.
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


@dataclass
class Pair:
    """Corners of the board (N x 2, pixels) in the two pictures of one moment; None where it is not seen.

    unreadable: a line where a picture cannot be read.
    """
    name: str
    depth: Optional[np.ndarray]
    color: Optional[np.ndarray]
    unreadable: str = ""

    @property
    def problem(self):
        """Why it is no view of the board for both cameras; empty if it is."""
        missing = [camera for camera in CAMERAS if getattr(self, camera) is None]
        return self.unreadable or (f"no board in the {' and the '.join(missing)} picture" if missing else "")


def read_pairs(folders, board, warn, progress=iter):
    """([Pair], sizes of the cameras' pictures (width, height)): files of the same name in both folders, apart from the
    suffix, are a pair. warn: gets a line for what is left out. ValueError where no picture of a camera can be read."""
    files = [_images(folder) for folder in folders]
    names = sorted(set(files[0]) & set(files[1]))
    if not names:
        raise ValueError(f"no picture of {folders[0]} has a counterpart of the same name in {folders[1]}")
    for folder, of_stems in zip(folders, files):
        alone = sorted(set(of_stems) - set(names))
        if alone:
            warn(f"{folder}: no picture in the other folder is named like {', '.join(alone)}: left out")
    pairs, sizes = [], [None, None]
    for name in progress(names):
        corners, unreadable = [None, None], []
        for camera, folder in enumerate(folders):
            path = Path(folder, files[camera][name])
            try:
                image = read_image(path, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
            except StackError as error:
                unreadable.append(str(error))
                continue
            size = image.shape[1::-1]
            sizes[camera] = width, height = sizes[camera] or size
            if size != (width, height):
                raise ValueError(f"{path}: {size[0]}x{size[1]} pixels, but the {CAMERAS[camera]} camera's pictures "
                                 f"before it have {width}x{height}")
            corners[camera] = find_corners(image, board)
        pairs.append(Pair(name, *corners, "; ".join(unreadable)))
    for pair in pairs:
        if pair.unreadable:
            warn(f"{pair.unreadable}: left out")
    for folder, size in zip(folders, sizes):
        if size is None:
            raise ValueError(f"{folder}: none of the {len(names)} pictures can be read")
    return pairs, tuple(sizes)


def _images(folder):
    """File names by stem."""
    names = sorted(path.name for path in Path(folder).iterdir() if is_image_name(path.name))
    if not names:
        raise ValueError(f"{folder}: holds no images")
    by_stem = {}
    for name in names:
        other = by_stem.setdefault(Path(name).stem, name)
        if other != name:
            raise ValueError(f"{folder}: {other} and {name} differ in their ending only: remove one")
    return by_stem
