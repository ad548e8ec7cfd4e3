# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Does a rig place the jumps of a depth image on the edges of the colour picture? For check_rig.

contours() finds the jumps, fit_edges() compares them with the picture, overlay() draws both.
"""
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from all_in_focus import installed
from all_in_focus.files.rig import load_rig
from all_in_focus.files.stack import read_depth
from all_in_focus.imaging import fill_from_farther, with_lines

JUMP = 0.06  # least step in depth, of the nearer depth
STEADY = 3  # a jump is so many times steeper than the surface on either side
BORDER = 4  # pixels
NEAR_COLOR, FAR_COLOR = (0, 140, 255), (255, 120, 40)  # BGR: orange, blue
DIM = 0.75  # brightness of the picture under the overlay
WIDTH = 1000  # pixels: wider pictures are compared at this width
REACH = 12  # pixels at that width: shifts that are tried, in each direction
SMOOTH = 1.2  # pixels: standard deviation, of the picture and of the scores
SURROUNDINGS = 41  # pixels: side of the window to which an edge's gradient is compared
BLOCK = 40  # pixels: borders within a block are one observation
DRAWS = 300  # of the bootstrap
ENOUGH = 10  # blocks, at least
SURE = 1.5  # pixels at that width: greatest standard deviation of a shift that counts as known
AWAY, FALL = 4, 0.2  # a peak falls by this share of its height at this distance in pixels
SMALL = 1.5  # pixels at that width: a Kinect's own edges are no more precise


def require_size(name, size, wanted):
    if tuple(size) != tuple(wanted):
        raise ValueError(f"{name}: {size[0]}x{size[1]} pixels, but the pictures have {wanted[0]}x{wanted[1]}")


def registered_depth(args, size):
    """H x W, uint16 mm, 0 = unknown: that of --registered-depth, or that of --depth as the nodes register it by --rig. ValueError
    where that cannot be done, or its size is not that of the pictures (width, height)."""
    if args.registered_depth:
        depth = read_depth(args.registered_depth)
        require_size(args.registered_depth, depth.shape[1::-1], size)
        return depth
    rig = load_rig(args.rig)
    require_size(f"{args.rig}/color.yaml", (rig.color.width, rig.color.height), size)
    if not read_depth(args.depth, rig.depth).any():
        return np.zeros(size[::-1], np.uint16)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "registered.png")
        try:
            installed.run([installed.find("check_depth"), "--rig", args.rig, "--depth", args.depth, "--save-registered", path])
        except RuntimeError as error:
            raise ValueError(str(error).replace("check_depth: ", "", 1))
        return read_depth(path)


@dataclass
class Contours:
    """Borders of near objects in the colour picture, pixels. at: N x 2; normal: N x 2, towards the farther side; far:
    N x 2, where the farther side begins."""
    at: np.ndarray
    normal: np.ndarray
    far: np.ndarray


def _jumps(filled, measured, axis):
    """(near, far): row and column of the pixels on both sides of each jump along an axis, N x 2."""
    step = np.diff(filled, axis=axis)
    size = np.abs(step)
    one, other = (np.delete(filled, index, axis=axis) for index in (-1, 0))
    lower = np.minimum(one, other)
    before, after = np.roll(size, 1, axis), np.roll(size, -1, axis)
    found = (lower > 0) & (size > JUMP * lower) & (size > STEADY * np.minimum(before, after))
    first = np.argwhere(found)
    second = first + (np.arange(2) == axis)
    forward = (step[found] > 0)[:, None]  # the second pixel is the farther one
    near, far = np.where(forward, first, second), np.where(forward, second, first)
    inside = ((near >= BORDER) & (near < np.array(filled.shape) - BORDER)).all(axis=1) & measured[tuple(near.T)]
    return near[inside], far[inside]


def _first_measured(measured, at, step):
    """The first measured pixel from each pixel on, in its direction, or the last before the border; all N x 2."""
    at, last = at.copy(), np.array(measured.shape) - 1
    while True:
        following = np.clip(at + step, 0, last)
        moving = ~measured[tuple(at.T)] & (following != at).any(axis=1)
        if not moving.any():
            return at
        at[moving] = following[moving]


def contours(depth):
    """Contours of a depth image that is registered to the colour picture: uint16 mm, 0 = unknown."""
    skip = max(1, depth.shape[1] // (2 * WIDTH))  # depth cameras have fewer pixels than large pictures
    depth = depth[skip // 2::skip, skip // 2::skip]
    calm = np.where(depth > 0, cv2.medianBlur(np.ascontiguousarray(depth), 5), 0)
    # What the depth camera does not see lies on the background: the jump is at its nearer side.
    filled = fill_from_farther(calm).astype(np.float64)
    near, far = (np.concatenate(pixels) for pixels in zip(*(_jumps(filled, calm > 0, axis) for axis in (0, 1))))
    normal = (far - near)[:, ::-1].astype(float)
    at, begin = (pixels[:, ::-1] * skip + skip // 2 for pixels in ((near + far) / 2, _first_measured(calm > 0, far, far - near)))
    return Contours(at, normal, begin)


def _edges(image):
    """Gradient (x, y) of a picture, H x W each, length at most 1: relative to the gradients around it."""
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    gray = cv2.GaussianBlur(gray, (0, 0), SMOOTH)
    x, y = cv2.Sobel(gray, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(gray, cv2.CV_32F, 0, 1, scale=1 / 8)
    strength = x * x + y * y
    around = cv2.blur(strength, (SURROUNDINGS, SURROUNDINGS)) + 1.0
    weight = 1 / np.sqrt(strength + 2 * around)
    return x * weight, y * weight


def _scores(edges, at, normal):
    """Agreement of each border pixel at each shift, N x shifts x shifts (y, x); 0 outside the picture."""
    padded = [cv2.copyMakeBorder(edge, REACH, REACH, REACH, REACH, cv2.BORDER_CONSTANT) for edge in edges]
    column, row = np.rint(at).astype(int).T
    found = np.empty((len(at), 2 * REACH + 1, 2 * REACH + 1), np.float32)
    for i in range(2 * REACH + 1):
        for j in range(2 * REACH + 1):
            across = padded[0][row + i, column + j] * normal[:, 0] + padded[1][row + i, column + j] * normal[:, 1]
            found[:, i, j] = across * across
    return found


def _peak(score):
    """(x, y) of the maximum of a score over the shifts, with subpixel precision."""
    row, column = np.unravel_index(np.argmax(score), score.shape)
    return np.array([column + _vertex(score[row], column), row + _vertex(score[:, column], row)]) - REACH


def _vertex(values, at):
    if not 0 < at < len(values) - 1:
        return 0.0
    low, high = values[at] - values[at - 1], values[at] - values[at + 1]
    return 0.5 * (low - high) / (low + high) if low + high > 0 else 0.0


def _distinct(score, shift):
    """Whether the score falls off on both sides of its peak, in x and y. Along straight edges it does not."""
    place = np.arange(score.shape[0]) - REACH
    height = score.max() - np.median(score)
    away = [np.abs(place - middle) >= AWAY for middle in shift]
    return np.array([score.max() - score.max(axis=axis)[far].max() > FALL * height for axis, far in zip((0, 1), away)])


def fit_edges(image, contours):
    """Two lines: how well Contours lie on the edges of a BGR picture of 8 bit, and whether a shift would fit better."""
    scale = min(1.0, WIDTH / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
    at = np.clip((contours.at + 0.5) * scale - 0.5, 0, np.array(small.shape[1::-1]) - 1)
    blocks, members = np.unique((at // BLOCK).astype(int), axis=0, return_inverse=True)
    cannot_tell = "cannot tell whether it fits: too few depth edges are edges of the picture"
    if len(blocks) < ENOUGH:
        return [f"too few depth edges to compare ({len(at)} border pixels)", cannot_tell]
    scores = _scores(_edges(small), at, contours.normal)
    sums = np.array([np.bincount(members.ravel(), column, len(blocks)) for column in scores.reshape(len(at), -1).T])
    counts = np.bincount(members.ravel(), minlength=len(blocks))

    def score(weights):
        values = ((sums @ weights) / (counts @ weights)).reshape(scores.shape[1:]).astype(np.float32)
        return cv2.GaussianBlur(values, (0, 0), SMOOTH)

    whole = score(np.ones(len(blocks)))
    # Bootstrap: how far the peak varies when the blocks are drawn again from these, with replacement.
    rng = np.random.default_rng(0)
    draws = rng.multinomial(len(blocks), np.full(len(blocks), 1 / len(blocks)), DRAWS)
    shift, deviation = _peak(whole), np.std([_peak(score(draw)) for draw in draws], axis=0)
    sure = (deviation < SURE) & _distinct(whole, shift)
    chance = np.median(whole)
    numbers = (f"edges agree {whole[REACH, REACH]:.2f} as they are, {whole.max():.2f} at best, {chance:.2f} by chance "
               f"({len(at)} border pixels)")
    if whole.max() <= whole.mean() + 3 * np.median(np.abs(whole - chance)):  # the best shift does not stand out of all others
        return [numbers, cannot_tell]
    (x, y), (x_deviation, y_deviation) = shift / scale, deviation / scale
    found = f"({x:+.1f}, {y:+.1f}) px +- ({x_deviation:.1f}, {y_deviation:.1f})"
    if not sure.any():
        return [numbers, f"cannot tell whether a shift would fit better: found {found}"]
    reasons = ("x, too few upright edges", "y, too few level edges")
    found += "".join(f"; unsure in {reason}" for reason, known in zip(reasons, sure) if not known)
    if (sure & (np.abs(shift) > np.maximum(SMALL, 2 * deviation))).any():
        return [numbers, f"edges fit best when shifted by {found}"]
    return [numbers, f"fits: no shift is clearly better, best {found}"]


def overlay(image, contours, lines):
    """BGR picture with the borders of near objects in orange, the begin of the far side in blue, and lines of text."""
    shown = (image * DIM).astype(np.uint8)
    radius = max(0, round(image.shape[1] / 1000))
    for points, color in ((contours.far, FAR_COLOR), (contours.at, NEAR_COLOR)):
        for x, y in np.rint(points).astype(int):
            cv2.circle(shown, (int(x), int(y)), radius, color, -1)
    return with_lines(shown, ["orange: border of what is near; blue: where the far side begins"] + lines)
