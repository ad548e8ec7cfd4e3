# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Do stamps grow, do the clocks of both cameras agree, is there depth for every bracket?"""
import numpy as np

from all_in_focus.bag.check.findings import counted
from all_in_focus.bag.scan import NS

CLOCKS_APART = 5.0  # s between the delays of depth and colour; a DSLR takes a second or two to hand out a picture
OLD = 60.0          # s from which depth is of another scene
ODD_DELAY = 60.0    # s between stamp and recording
TITLES = {"depth": "depth", "rgb": "colour"}


def check_stamps(check, bag, scan, all_without_depth):
    """all_without_depth: no bracket finds its depth, so that what is wrong with stamps matters."""
    complain = check.error if all_without_depth else check.warning
    rates = []
    for kind, title in TITLES.items():
        heads, name = getattr(scan, kind), bag.topics[kind]
        stamps = np.array([head.stamp for head in heads], np.int64)
        zero = int((stamps == 0).sum())
        if zero:
            # One moment for all frames: the nodes keep the last of each kind.
            level = check.error if kind == "rgb" and zero == len(stamps) else complain
            level("%s: %d of %d stamps are zero: set them in the camera's driver" % (name, zero, len(stamps)))
            continue
        steps = np.diff(stamps)
        back = np.flatnonzero(steps < 0)
        if len(back):
            check.warning("%s: stamps go back %s, by up to %.3f s, first after %.6f: images out of order, a restarted "
                          "driver, or two recordings in one bag"
                          % (name, counted(len(back), "time"), -steps.min() / NS, stamps[back[0]] / NS))
        if kind == "rgb" and (steps == 0).any():
            check.warning("%s: %s of the image before: set them in the camera's driver"
                          % (name, counted(int((steps == 0).sum()), "image has the stamp")))
        if len(steps) and steps.max() > 0:
            rates.append("%s at %.3g Hz" % (title, NS / np.median(steps[steps > 0])))
    delays = {kind: _delay(getattr(scan, kind)) for kind in TITLES}
    delays = {kind: delay for kind, delay in delays.items() if delay is not None}
    _check_clocks(check, complain, delays)
    told = ["%s recorded %.3f s after its stamp" % (TITLES[kind], delay) for kind, delay in delays.items()]
    check.ok(", ".join(rates + told))


def _delay(heads):
    """Median time from stamp to recording, s; None where there are no stamps."""
    delays = [head.recorded - head.stamp for head in heads if head.stamp]
    return float(np.median(delays)) / NS if delays else None


def _check_clocks(check, complain, delays):
    ahead = delays["rgb"] - delays["depth"] if len(delays) == 2 else 0  # so much older colour looks
    longest = max(delays.values(), key=abs, default=0)
    if abs(ahead) > CLOCKS_APART:
        complain("colour is stamped %s %s than depth, going by when both were recorded: the clocks of two machines "
                 "differ: synchronise them (chrony), or correct the stamps"
                 % (duration(abs(ahead)), "earlier" if ahead > 0 else "later"))
    elif abs(longest) > ODD_DELAY:
        check.warning("images were recorded %s %s their stamps: from another bag that was played, or by a machine "
                      "whose clock is wrong; with tf that moves this matters live"
                      % (duration(abs(longest)), "after" if longest > 0 else "before"))


def check_depth_in_time(check, brackets, usable, rules):
    """usable: heads of depth images that the nodes do not refuse, one at least."""
    without = [(number, bracket) for number, bracket in enumerate(brackets) if bracket.depth is None]
    if without:
        number, bracket = without[0]
        everywhere = len(without) == len(brackets)
        where = "bracket %d" % number
        if len(brackets) > 1:
            share = "all" if everywhere else "%d of %d" % (len(without), len(brackets))
            where = "%s brackets, such as %s" % (share, where)
        (check.error if everywhere else check.warning)(
            "%s: no depth image at or before the first frame and not older than %g s (%s): fused by sharpness alone"
            % (where, rules.max_age, _nearest(bracket, usable)))
        return
    ages = [(bracket.frames[0].head.stamp - bracket.depth.stamp) / NS for bracket in brackets]
    check.ok("every bracket has depth, at most %.3f s older than its first frame" % max(ages))


def _nearest(bracket, usable):
    first = bracket.frames[0].head
    gaps = np.array([(first.stamp - head.stamp) / NS for head in usable])
    before = gaps[gaps >= 0]
    if not len(before):
        return "the first depth comes %s too late: start the depth camera first" % duration(-gaps.max())
    age = before.min()
    if age == 0:
        return "the one that belongs to it is recorded too long after its frames"
    return "the newest before it is %s old%s" % (duration(age), ": --label-max-age allows more" if age < OLD else "")


def duration(seconds):
    """0.5 -> 0.5 s, 3612 -> 1 h 0 min 12 s."""
    if seconds < 120:
        return "%.4g s" % seconds
    days, rest = divmod(int(seconds + 0.5), 86400)
    parts = [(days, "d"), (rest // 3600, "h"), (rest // 60 % 60, "min"), (rest % 60, "s")]
    while parts[0][0] == 0:
        parts.pop(0)
    return " ".join("%d %s" % part for part in parts[:3])
