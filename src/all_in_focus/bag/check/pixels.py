# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Do the nodes accept the images, are depths plausible, does the exposure stay, and does the focus move?"""
from collections import Counter

import cv2
import numpy as np

from all_in_focus.bag.check.findings import share_text
from all_in_focus.image_messages import METRES, bgr, depth_as_sent
from all_in_focus.bag.scan import NS
from all_in_focus.files.errors import counted
from all_in_focus.imaging import CHECKED_WIDTH, FocusCheck, shrunk, srgb_to_linear, white_code

MOST_METRES = 100             # medians beyond are mm
MOSTLY_UNKNOWN = 0.7
NO_READING = 2047             # of a raw Kinect stream: no measurement
NOTICEABLE = 0.01             # share of pixels
BRACKETS, FRAMES = 3, 30      # at most so many brackets are sampled, so many frames of them together
BLOCKS = (8, 6)               # of a picture; blur preserves the mean light of a block
DARK, BRIGHT = 0.005, 0.75    # linear light between which a block's mean counts
EXPOSURE_STEP = 0.05          # relative change of light that gets a warning


def check_images(check, bag, scan, kind):
    """Returns the heads of the images that the nodes accept. kind: "depth" or "rgb"."""
    heads, name = getattr(scan, kind), bag.topics[kind]
    good = [head for head in heads if not head.problem]
    for text, number in Counter(head.problem for head in heads if head.problem).most_common(3):
        if not good:
            check.error(f"{name}: {text}")
        else:
            first = next(head for head in heads if head.problem == text)
            check.warning(f"{name}: {number} of {len(heads)} images, the first at "
                          f"{(first.recorded - scan.start) / NS:.3f} s: {text}")
    if not heads:
        check.error(f"{name}: no image can be read")
    sizes = Counter(head.size for head in good)
    if len(sizes) > 1:
        counts = ", ".join(f"{size[0]}x{size[1]}: {number}" for size, number in sizes.most_common())
        check.warning(f"{name}: sizes differ ({counts}): frames of another size than the first of their bracket "
                      "are left out")
    encodings = sorted({head.encoding for head in good})
    for encoding in encodings:
        if encoding.startswith("bayer_"):
            check.warning(f"{name}: {encoding} is interpolated by the simplest method: record the output of "
                          "image_proc's debayer instead")
    if good:
        check.ok(f"{counted(len(heads), 'image')}, {good[0].size[0]}x{good[0].size[1]} {', '.join(encodings)}")
    return good


def check_depth_values(check, name, messages, images, unit):
    """name: topic; images: H x W mm, 0 = unknown, of the same messages; unit: what check_depth says of the first, or empty."""
    encoding = messages[0].encoding
    values = np.concatenate([image.ravel() for image in images])
    known = values[values > 0]
    sent = np.concatenate([depth_as_sent(message).ravel() for message in messages])
    sent = sent[np.isfinite(sent) & (sent > 0)]
    if encoding == METRES and len(sent) and np.median(sent) >= MOST_METRES:
        unit = f"half of the values are above {np.median(sent):.4g}: mm, but 32FC1 means m: divide by 1000, or send 16UC1"
    if unit:
        (check.warning if len(known) else check.error)(f"{name}: {unit}")
    elif not len(known):
        check.error(f"{name}: not one pixel has a depth: is something too near, or the sensor covered?")
    if not len(known):
        return
    unknown = 1 - len(known) / len(values)
    near, middle, far = np.percentile(known, [2, 50, 98]) / 1000
    if unknown > MOSTLY_UNKNOWN:
        check.warning(f"{name}: {share_text(unknown)} of the pixels have no depth: too near, too far, too dark or "
                      "in sunlight?")
    no_reading = (values == NO_READING).mean()
    if encoding != METRES and no_reading > NOTICEABLE:
        check.warning(f"{name}: {share_text(no_reading)} of the pixels are exactly {NO_READING} mm, which means "
                      f"unknown in a raw Kinect stream: --invalid-values [0,{NO_READING},65535]")
    check.ok(f"{near:.2f} to {far:.2f} m, half of them below {middle:.2f} m; {share_text(unknown)} unknown")


def sample(items, most):
    """At most `most` items, evenly spaced, with the first and the last."""
    if len(items) <= most:
        return list(items)
    return [items[index] for index in np.unique(np.linspace(0, len(items) - 1, most).round().astype(int))]


class Sample:
    """Measurements of some frames of one bracket, read one at a time.

    light: frames x blocks, mean linear light; focus: FocusCheck. bracket: of frames that check_images() has accepted.
    """

    def __init__(self, bag, number, bracket, most):
        self.number, self.light, self.focus, self.frames = number, [], FocusCheck(), []
        size, pictures, highest = None, [], 0
        for frame in sample(bracket.frames, most):
            picture = bgr(bag.read_at(frame.head.place), deep=True)
            size = size or picture.shape
            if picture.shape != size:
                continue
            highest = max(highest, picture.max())
            pictures.append(shrunk(picture, CHECKED_WIDTH))
            self.frames.append(frame)
        for picture in pictures:
            codes = np.float32(picture) * (255 / white_code(highest) if picture.dtype == np.uint16 else 1)
            self.light.append(cv2.resize(srgb_to_linear(cv2.cvtColor(codes, cv2.COLOR_BGR2GRAY)), BLOCKS,
                                         interpolation=cv2.INTER_AREA).ravel())
            self.focus.add(codes)


def check_exposure(check, brackets, samples):
    worst = 0.0
    for one in samples:
        if len(one.frames) < 2:
            continue
        gains = relative_light(np.array(one.light))
        if gains is None:
            check.bracket_warning(one.number, "too dark or too bright to compare: correct the exposure")
            continue
        change = gains.max() / gains.min() - 1
        worst = max(worst, change)
        if change > EXPOSURE_STEP:
            odd = int(np.abs(np.log(gains)).argmax())
            check.bracket_warning(one.number, f"the light changes by {share_text(change)}, most in frame "
                                              f"{one.frames[odd].index} ({100 * (gains[odd] - 1):+.0f} %): fix "
                                              "exposure, ISO and white balance in the camera")
    check.ok(f"the light of {counted(sum(len(one.frames) for one in samples), 'frame')} in "
             f"{counted(len(samples), 'bracket')} changes by at most {share_text(worst)}", brackets)


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
    for number, bracket in enumerate(brackets):
        same = sum(a.head.checksum == b.head.checksum for a, b in zip(bracket.frames, bracket.frames[1:]))
        if same:
            check.bracket_warning(number, f"{counted(same, 'frame')} with exactly the pixels of the frame before: did the "
                                          "camera take a new picture?")
    for one in samples:
        if one.focus.stood_still:
            check.bracket_warning(one.number, "all frames are equally sharp: does the focus move? (lens switched to "
                                              "manual, step size, focus limit)")
    check.ok("sharpness changes from frame to frame", len(brackets))
