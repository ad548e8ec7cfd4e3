# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How well the borders of near things lie on edges of the colour picture, and whether a shift would fit better."""
from dataclasses import dataclass

import cv2
import numpy as np

WIDTH = 1000  # pixels: larger pictures are compared at this size
REACH = 12  # pixels there: shifts that are tried, each way
SMOOTH = 1.2  # pixels: standard deviation, of the picture and of the scores
SURROUNDINGS = 41  # pixels: an edge counts by how it stands out of these
BLOCK = 40  # pixels: borders that lie so near to each other are one observation
DRAWS = 300
ENOUGH = 10  # blocks
SURE = 1.5  # pixels of the picture compared: a shift known worse than that is not known
AWAY, FALL = 4, 0.2  # pixels there; share of the peak's height: less is no peak
SMALL = 1.5  # pixels there: a Kinect draws its edges no better


@dataclass
class EdgeFit:
    """Agreement 0..1 as it is, when shifted best, and by chance; shift (x, y) and its standard deviation, pixels."""
    agreement: float
    best: float
    chance: float
    shift: np.ndarray
    deviation: np.ndarray
    borders: int
    sure: np.ndarray  # of x and y
    clear: bool  # the best shift stands out of all others
    shifted: bool  # and is not none

    def lines(self):
        """What to tell."""
        numbers = "edges agree %.2f as they are, %.2f at best, %.2f by chance (%d border pixels)" % (
            self.agreement, self.best, self.chance, self.borders)
        shift = "(%+.1f, %+.1f) px +- (%.1f, %.1f)" % (*self.shift, *self.deviation)
        if not self.clear:
            return [numbers, "cannot tell whether it fits: too few depth edges are edges of the picture"]
        if not self.sure.any():
            return [numbers, "cannot tell whether a shift would fit better: found %s" % shift]
        reasons = ("x, too few upright edges", "y, too few level edges")
        note = "".join("; unsure in " + reason for reason, sure in zip(reasons, self.sure) if not sure)
        if self.shifted:
            return [numbers, "edges fit best when shifted by %s%s" % (shift, note)]
        return [numbers, "fits: no shift is clearly better, best %s%s" % (shift, note)]


def _edges(image):
    """Gradient (x, y) of a picture, H x W each, at most 1 long: by how an edge stands out, not by its contrast."""
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    gray = cv2.GaussianBlur(gray, (0, 0), SMOOTH)
    x, y = cv2.Sobel(gray, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(gray, cv2.CV_32F, 0, 1, scale=1 / 8)
    strength = x * x + y * y
    around = cv2.blur(strength, (SURROUNDINGS, SURROUNDINGS)) + 1.0
    weight = 1 / np.sqrt(strength + 2 * around)
    return x * weight, y * weight


def _scores(edges, at, normal):
    """Agreement of every border pixel at every shift, N x shifts x shifts (y, x); 0 beyond the picture."""
    padded = [cv2.copyMakeBorder(edge, REACH, REACH, REACH, REACH, cv2.BORDER_CONSTANT) for edge in edges]
    column, row = np.rint(at).astype(int).T
    found = np.empty((len(at), 2 * REACH + 1, 2 * REACH + 1), np.float32)
    for i in range(2 * REACH + 1):
        for j in range(2 * REACH + 1):
            across = padded[0][row + i, column + j] * normal[:, 0] + padded[1][row + i, column + j] * normal[:, 1]
            found[:, i, j] = across * across
    return found


def _peak(score):
    """(x, y) of the highest place of a score over the shifts, to a fraction."""
    row, column = np.unravel_index(np.argmax(score), score.shape)
    return np.array([column + _vertex(score[row], column), row + _vertex(score[:, column], row)]) - REACH


def _vertex(values, at):
    if not 0 < at < len(values) - 1:
        return 0.0
    low, high = values[at] - values[at - 1], values[at] - values[at + 1]
    return 0.5 * (low - high) / (low + high) if low + high > 0 else 0.0


def _distinct(score, shift):
    """Whether the score falls off to both sides of its peak, in x and y; along straight edges it does not."""
    place = np.arange(score.shape[0]) - REACH
    height = score.max() - np.median(score)
    away = [np.abs(place - middle) >= AWAY for middle in shift]
    return np.array([score.max() - score.max(axis=axis)[far].max() > FALL * height for axis, far in zip((0, 1), away)])


def fit_edges(image, contours, seed=0):
    """EdgeFit of contours.Contours on a BGR picture of 8 bit."""
    scale = min(1.0, WIDTH / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
    at = np.clip((contours.at + 0.5) * scale - 0.5, 0, np.array(small.shape[1::-1]) - 1)
    blocks, members = np.unique((at // BLOCK).astype(int), axis=0, return_inverse=True)
    nothing = np.zeros(2)
    if len(blocks) < ENOUGH:
        return EdgeFit(0, 0, 0, nothing, nothing, len(at), np.zeros(2, bool), False, False)
    scores = _scores(_edges(small), at, contours.normal)
    sums = np.array([np.bincount(members.ravel(), column, len(blocks)) for column in scores.reshape(len(at), -1).T])
    counts = np.bincount(members.ravel(), minlength=len(blocks))

    def score(weights):
        values = ((sums @ weights) / (counts @ weights)).reshape(scores.shape[1:]).astype(np.float32)
        return cv2.GaussianBlur(values, (0, 0), SMOOTH)

    whole = score(np.ones(len(blocks)))
    # What would be found had other blocks been seen: drawn anew from these, again and again.
    rng = np.random.default_rng(seed)
    draws = rng.multinomial(len(blocks), np.full(len(blocks), 1 / len(blocks)), DRAWS)
    peaks = np.array([_peak(score(draw)) for draw in draws])
    shift, deviation = _peak(whole), peaks.std(axis=0)
    sure = (deviation < SURE) & _distinct(whole, shift)
    clear = bool(whole.max() > whole.mean() + 3 * np.median(np.abs(whole - np.median(whole))))
    shifted = bool((sure & (np.abs(shift) > np.maximum(SMALL, 2 * deviation))).any())
    return EdgeFit(float(whole[REACH, REACH]), float(whole.max()), float(np.median(whole)), shift / scale,
                   deviation / scale, len(at), sure, clear, shifted)
