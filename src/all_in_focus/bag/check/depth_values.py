# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Are the depths such as a sensor measures, in the unit that the encoding means?"""
import numpy as np

from all_in_focus.bag.check.findings import share_text
from all_in_focus.bag.images import METRES, depth_as_sent

NEAR_MM, FAR_MM = 150, 20000  # medians beyond are mistakes
MOSTLY_UNKNOWN = 0.7
NO_READING = 2047             # what a raw Kinect stream gives for nothing
NOTICEABLE = 0.01             # share of pixels


def check_depth_values(check, name, messages, images):
    """name: topic; images: H x W mm, 0 = unknown, of the same messages."""
    encoding = messages[0].encoding
    values = np.concatenate([image.ravel() for image in images])
    known = values[values > 0]
    sent = np.concatenate([depth_as_sent(message).ravel() for message in messages])
    sent = sent[np.isfinite(sent) & (sent > 0)]
    unit = _wrong_unit(encoding, sent)
    if unit:
        check.error("%s: %s" % (name, unit)) if not len(known) else check.warning("%s: %s" % (name, unit))
    elif not len(known):
        check.error("%s: not one pixel has a depth: is something too near, or the sensor covered?" % name)
    if not len(known):
        return
    unknown = 1 - len(known) / len(values)
    near, middle, far = np.percentile(known, [2, 50, 98]) / 1000
    if unknown > MOSTLY_UNKNOWN:
        check.warning("%s: %s of the pixels have no depth: too near, too far, too dark or in sunlight?"
                      % (name, share_text(unknown)))
    no_reading = (values == NO_READING).mean()
    if encoding != METRES and no_reading > NOTICEABLE:
        check.warning("%s: %s of the pixels are exactly %d mm, what a raw Kinect stream gives for nothing: "
                      "--invalid-values [0,%d]" % (name, share_text(no_reading), NO_READING, NO_READING))
    if not unit and not NEAR_MM <= middle * 1000 <= FAR_MM:
        check.warning("%s: half of the depths are %s %.3g m: is the unit right (16UC1: mm, 32FC1: m)?"
                      % (name, "below" if middle < 1 else "above", middle))
    check.ok("%.2f to %.2f m, half of them below %.2f m; %s unknown" % (near, far, middle, share_text(unknown)))


def _wrong_unit(encoding, sent):
    """What mm written as metres look like, and the reverse."""
    if not len(sent):
        return ""
    middle = np.median(sent)
    if encoding == METRES and middle >= 100:
        return "half of the values are above %.4g: mm, but 32FC1 means m: divide by 1000, or send 16UC1" % middle
    if encoding != METRES and middle <= 20:
        return ("half of the values are %d or less: m, but %s means mm: multiply by 1000, or send 32FC1"
                % (middle, encoding))
    return ""
