# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The focus distance of each frame of a bracket, from the frame in which surfaces of known depth are sharpest.

The picture is divided into tiles. A tile whose depth is one distance tells, in dioptres, where the frame is focused in
which it is sharpest. A curve through all of them gives the distance of every frame: in dioptres it is nearly a line.
"""
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.stats import siegelslopes

from all_in_focus.calibration.board import gray
from all_in_focus.imaging import gradient_energy

TILES = 40  # across the picture
ENOUGH_PIXELS = 4  # with depth, in a tile
ONE_DISTANCE = 0.12  # 1/m: a tile and those around it span no more
PROMINENT = 1.2  # a tile is sharpest in one frame: its gradients, squared, are so many times those before and after it
FEWEST = 20  # tiles
SHORTEST = 2.0  # frames that the peaks must span
FARTHEST = 1e-3  # 1/m; a frame that the curve places beyond is focused beyond infinity
TUKEY, ROUNDS = 4.7, 20  # outlier limit in standard deviations; rounds of reweighting
BENT = 0.9  # a curve must leave so much less error than a line


class Sharpness:
    """Sharpness of each tile in each frame; keeps no frame. frames: of each, rows x columns; size: of the pictures."""

    def __init__(self):
        self.frames, self.size = [], None

    def add(self, image):
        size = image.shape[1::-1]
        self.size = self.size or size
        if size != self.size:
            raise ValueError(f"a picture has {size[0]}x{size[1]} pixels, those before it "
                             f"{self.size[0]}x{self.size[1]}")
        side, columns, rows = self.grid()
        self.frames.append(gradient_energy(gray(image)[:rows * side, :columns * side], (columns, rows))[0])

    def grid(self):
        """(side of a tile in pixels, columns, rows)."""
        side = max(8, self.size[0] // TILES)
        return side, self.size[0] // side, self.size[1] // side


def dioptres_of_registered(depth, grid):
    """1/m of each tile, rows x columns; NaN where depth is unknown, or not one distance. depth: mm, 0 = unknown, registered to
    the pictures; grid: of Sharpness.grid()."""
    side, columns, rows = grid
    tiles = depth[:rows * side, :columns * side].reshape(rows, side, columns, side).swapaxes(1, 2).reshape(rows, columns, -1)
    known = tiles > 0
    dioptre = 1000.0 / np.maximum(tiles, 1)
    count = known.sum(axis=2)
    low, high = dioptre.min(axis=2, where=known, initial=np.inf), dioptre.max(axis=2, where=known, initial=-np.inf)
    around = np.ones((3, 3), np.uint8)  # the blur of what is beside a tile reaches into it
    with np.errstate(over="ignore", invalid="ignore"):  # where nothing is known
        spread = cv2.dilate(high, around) - cv2.erode(low, around)
    mean = dioptre.sum(axis=2, where=known) / np.maximum(count, 1)
    return np.where((count >= ENOUGH_PIXELS) & (spread < ONE_DISTANCE), mean, np.nan)


def peak_of(sharpness):
    """Place of the greatest value between the frames: the vertex of a parabola through the logarithms of the upper half of
    the peak. NaN where sharpness does not fall on both sides. sharpness: one value a frame."""
    best = int(np.argmax(sharpness))
    foot = max(sharpness[:best + 1].min(), sharpness[best:].min())
    if sharpness[best] <= PROMINENT * foot:
        return np.nan
    half = (sharpness[best] + foot) / 2
    below = np.flatnonzero(sharpness <= half)  # on either side the foot is
    first, last = min(below[below < best].max() + 1, best - 1), max(below[below > best].min() - 1, best + 1)
    values = sharpness[first:last + 1]
    frame = np.arange(first, last + 1) - best
    bend, slope, _ = np.polyfit(frame, np.log(np.maximum(values, 1e-12)), 2, w=np.sqrt(values / values.max()))
    vertex = -slope / (2 * bend) if bend < 0 else np.nan
    return best + vertex if first - best <= vertex <= last - best else np.nan


@dataclass
class FocusCurve:
    """peaks, dioptres: of the tiles used, frames and 1/m; curve: polynomial of the frame index; error: standard deviation
    of the tiles from it, 1/m; inlier: whether a tile counts."""
    frames: int
    peaks: np.ndarray
    dioptres: np.ndarray
    inlier: np.ndarray
    curve: np.ndarray
    error: float

    def at(self, frame):
        """Dioptres of a frame, which may lie between two. Beyond the tiles the curve goes on in even steps."""
        used = self.peaks[self.inlier]
        end = np.clip(frame, used.min(), used.max())
        return np.polyval(self.curve, end) + np.polyval(np.polyder(self.curve), end) * (frame - end)

    def span(self):
        """Least and greatest dioptres of the tiles that count."""
        used = self.dioptres[self.inlier]
        return used.min(), used.max()

    def table(self, first, step):
        """Rows of a focus table: all frames but those beyond infinity. `first`, `step`: lens steps at the first frame and
        from frame to frame."""
        rows = [(index, float(self.at(index))) for index in range(self.frames)]
        return [{"step": first + index * step, "mm": 1000 / dioptre} for index, dioptre in rows if dioptre >= FARTHEST]


def fit(sharpness, dioptres):
    """FocusCurve of a Sharpness and the dioptres of its tiles. ValueError."""
    frames = np.array(sharpness.frames)  # frames x rows x columns
    if len(frames) < 3:
        raise ValueError(f"{len(frames)} frames: take a bracket of at least 3, better 9")
    known = np.argwhere(np.isfinite(dioptres))
    if len(known) < FEWEST:
        raise ValueError(f"only {len(known)} of {dioptres.size} tiles of the picture have one distance: is the depth "
                         "registered to these pictures, and is the scene made of large surfaces?")
    peaks = np.array([peak_of(frames[:, row, column]) for row, column in known])
    values = dioptres[tuple(known.T)][np.isfinite(peaks)]
    peaks = peaks[np.isfinite(peaks)]
    if len(peaks) < FEWEST:
        raise ValueError(f"only {len(peaks)} tiles become sharp within the bracket and blurred before and after: let "
                         "the first frame be focused nearer than the scene and the last one farther, on surfaces "
                         "with texture")
    span = np.percentile(peaks, 95) - np.percentile(peaks, 5)
    if span < SHORTEST:
        raise ValueError(f"all depths are sharpest within {span:.1f} frames: take a slanted board or a deeper "
                         "scene, or smaller steps")
    line, line_inlier, line_error = _robust(peaks, values, 1)
    curve, inlier, error = _robust(peaks, values, 2)
    ends = np.array([peaks[inlier].min(), peaks[inlier].max()]) if inlier.any() else np.zeros(2)
    slopes = np.polyval(np.polyder(curve), ends)
    if error > BENT * line_error or slopes.prod() <= 0:
        curve, inlier, error = line, line_inlier, line_error
    total = np.std(values[inlier])
    if inlier.sum() < max(FEWEST, len(peaks) / 3) or error > 0.5 * total:
        raise ValueError("sharpness and depth do not agree on the distances: do depth and pictures show the same, "
                         "does the rig fit (check_rig), are the frames in the order of their focus?")
    return FocusCurve(len(frames), peaks, values, inlier, curve, error)


def _robust(x, y, degree):
    """(polynomial, inliers, standard deviation) that outliers do not pull: reweighted from the line of repeated medians."""
    curve = np.array(siegelslopes(y, x))
    for _ in range(ROUNDS):
        off = y - np.polyval(curve, x)
        sigma = max(1.483 * np.median(np.abs(off)), 1e-6)
        weight = np.clip(1 - (off / (TUKEY * sigma)) ** 2, 0, None)
        curve = np.polyfit(x, y, degree, w=weight)
    off = np.abs(y - np.polyval(curve, x))
    return curve, off < TUKEY * sigma, sigma


def plot(curve, table, first, step):
    """BGR picture of curve.table(first, step): dots: tiles; red: the table; across: lens steps; up: dioptres, named by
    distance."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # takes a second
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter
    canvas = FigureCanvasAgg(Figure(figsize=(7.2, 4.8)))
    axes = canvas.figure.subplots()
    steps = first + step * curve.peaks
    axes.plot(steps[curve.inlier], curve.dioptres[curve.inlier], ".", color="tab:blue")
    axes.plot([row["step"] for row in table], [1000 / row["mm"] for row in table], "o-", color="tab:red", fillstyle="none")
    axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim(), xlabel="lens position, steps")  # outliers may lie anywhere
    axes.plot(steps[~curve.inlier], curve.dioptres[~curve.inlier], ".", color="lightgray", zorder=0)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda dioptre, _: f"{1 / dioptre:.3g} m" if dioptre > 0 else ""))
    axes.grid(axis="y")
    canvas.draw()
    return cv2.cvtColor(np.asarray(canvas.buffer_rgba()), cv2.COLOR_RGBA2BGR)
