# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""From a sample of the frames: does the exposure stay, and does the focus move?"""
import cv2
import numpy as np

from all_in_focus.bag.check.findings import PerBracket, counted, share_text
from all_in_focus.bag.images import ImageError, bgr
from all_in_focus.bag.scan import fetch
from all_in_focus.imaging import srgb_to_linear

BRACKETS, FRAMES = 3, 30      # samples at most, frames of all brackets together
BLOCKS = (8, 6)               # a picture is cut into: blur keeps the mean light of a block
DARK, BRIGHT = 0.005, 0.75    # linear light between which a block's mean counts
EXPOSURE_STEP = 0.05          # relative change of light that is a fault
SAME_SHARPNESS = 0.05         # relative change of the sharpest blocks' sharpness that noise may bring
WIDTH = 640                   # pixels to which larger pictures are reduced


def sample(items, most):
    """Evenly spread, first and last among them."""
    if len(items) <= most:
        return list(items)
    return [items[index] for index in np.unique(np.linspace(0, len(items) - 1, most).round().astype(int))]


class Sample:
    """Numbers of some frames of one bracket, read one at a time.

    light: frames x blocks, mean linear light; sharpness: frames x blocks, mean of the squared Laplacian; problem: of
    the first frame that cannot be read, or None.
    """

    def __init__(self, bag, number, bracket, most):
        self.number, self.light, self.sharpness, self.frames, self.problem = number, [], [], [], None
        size = None
        for frame in sample(bracket.frames, most):
            try:
                picture = bgr(fetch(bag, "rgb", frame.head))
            except ImageError as error:
                self.problem = self.problem or "frame %d: %s" % (frame.index, error)
                continue
            size = size or picture.shape
            if picture.shape != size:
                continue
            if picture.shape[1] > WIDTH:
                picture = cv2.resize(picture, (WIDTH, round(picture.shape[0] * WIDTH / picture.shape[1])),
                                     interpolation=cv2.INTER_AREA)
            gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
            self.light.append(_blocks(srgb_to_linear(gray)))
            # Smoothed first: noise does not move with the focus.
            edges = cv2.Laplacian(cv2.GaussianBlur(gray.astype(np.float32), (0, 0), 1), cv2.CV_32F)
            self.sharpness.append(_blocks(edges * edges))
            self.frames.append(frame)


def check_exposure(check, brackets, samples):
    worst, complaints = 0.0, PerBracket(check, brackets)
    for one in samples:
        if one.problem:
            complaints.warning(one.number, one.problem)
        if len(one.frames) < 2:
            continue
        gains = relative_light(np.array(one.light))
        if gains is None:
            complaints.warning(one.number, "too dark or too bright to compare: expose it right")
            continue
        change = gains.max() / gains.min() - 1
        worst = max(worst, change)
        if change > EXPOSURE_STEP:
            odd = int(np.abs(np.log(gains)).argmax())
            complaints.warning(one.number, "the light changes by %s, most in frame %d (%+.0f %%): fix exposure, ISO "
                               "and white balance in the camera"
                               % (share_text(change), one.frames[odd].index, 100 * (gains[odd] - 1)))
    complaints.tell()
    check.ok("the light of %s in %s changes by at most %s"
             % (counted(sum(len(one.frames) for one in samples), "frame"), counted(len(samples), "bracket"),
                share_text(worst)))


def relative_light(light):
    """Gain of each frame against the median frame; None where no block is well exposed in all frames.

    light: frames x blocks.
    """
    good = (light > DARK).all(axis=0) & (light < BRIGHT).all(axis=0)
    if not good.any():
        return None
    ratio = light[:, good] / np.median(light[:, good], axis=0)
    return np.median(ratio, axis=1)


def check_focus_change(check, brackets, samples):
    complaints = PerBracket(check, len(brackets))
    for number, bracket in enumerate(brackets):
        same = sum(a.head.checksum == b.head.checksum for a, b in zip(bracket.frames, bracket.frames[1:]))
        if same:
            complaints.warning(number, "%d times a frame is the one before to the last bit: did the camera take a new "
                               "picture?" % same)
    for one in samples:
        if len(one.frames) < 2:
            continue
        change = focus_change(np.array(one.sharpness))
        if change < SAME_SHARPNESS:
            complaints.warning(one.number, "all frames are equally sharp: does the focus move? (lens switched to "
                               "manual, step size, focus limit)")
    complaints.tell()
    check.ok("sharpness changes from frame to frame")


def focus_change(sharpness):
    """How much the sharpness of textured blocks changes, 0: not at all. sharpness: frames x blocks."""
    best = sharpness.max(axis=0)
    textured = best >= np.percentile(best, 75)  # the rest is mostly noise
    if not best[textured].any():
        return 0.0
    return float(np.median(1 - np.sqrt(sharpness[:, textured].min(axis=0) / best[textured])))


def _blocks(image):
    return cv2.resize(image, BLOCKS, interpolation=cv2.INTER_AREA).ravel()
