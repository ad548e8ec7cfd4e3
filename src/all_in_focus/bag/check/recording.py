# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Is everything recorded that the nodes need, under these names, with stamps that fit each other?"""
import re
from datetime import timedelta
from pathlib import Path

import numpy as np

from all_in_focus.bag.bag_file import REQUIRED, BagError
from all_in_focus.image_messages import METRES, MILLIMETRES
from all_in_focus.bag.options import option_of
from all_in_focus.bag.scan import NS
from all_in_focus.files.errors import counted

DEPTH = (*MILLIMETRES, METRES)
TRANSPORTS = ("compressedDepth", "compressed", "theora")  # that cannot be read here (compressed can, for colour)
CLOCKS_APART = 5.0  # s between the delays of depth and colour; a DSLR takes a second or two to deliver a picture
OLD = 60.0          # s; older depth is of another scene
ODD_DELAY = 60.0    # s between stamp and recording that get a warning
TITLES = {"depth": "depth", "rgb": "colour"}


def check_file(check, bag):
    check.ok(f"{Path(bag.path).stat().st_size / 1e6:.1f} MB")


def check_topics(check, bag, scan):
    for kind in bag.missing():
        check.error(f"no {REQUIRED[kind]}: {'; '.join(_where(bag, kind))}")
    for kind, problem in bag.wrong_types():
        remedy = suggestion(bag, kind)
        check.error(problem + (": " + remedy if remedy else ""))
    for kind in sorted({kind for kind, _ in scan.unreadable}):
        times = [time for which, time in scan.unreadable if which == kind]
        check.warning(f"{bag.topics.get(kind, '/' + kind)}: {counted(len(times), 'message')} cannot be read, the first recorded "
                      f"at {(times[0] - scan.start) / NS:.3f} s")
    names = [bag.topics[kind] for kind in REQUIRED]
    counts = ", ".join(f"{name} {bag.found[name].message_count}" if bag.has_topic(name) else name for name in names)
    check.ok(counts + (" (compressed colour: decoded frame by frame)" if names[2].endswith("/compressed") else ""))


def _where(bag, kind):
    """Parts of a line: what is missing, and which topic may be meant."""
    name = bag.topics[kind]
    yield f"nothing on {name}"
    for ending in TRANSPORTS:
        if bag.has_topic(f"{name}/{ending}"):
            yield (f"{name}/{ending} cannot be read: rosrun image_transport republish {ending} in:={name} raw "
                   f"out:={name}, and record that")
    other = suggestion(bag, kind)
    if other:
        yield other


def suggestion(bag, kind):
    """The topic that may be meant where the expected one is missing, with the option for it; empty if there is none."""
    names = _candidates(bag, kind)
    return f"of that type there is {', '.join(names[:5])}: {option_of(kind)} {names[0]}" if names else ""


def likely_topics(bag):
    """Name of each topic of a BagFile by kind: as it is called, else the likeliest other of that type; those of which the bag
    has none are left out."""
    return {kind: names[0] for kind in bag.topics
            for names in [[bag.topics[kind]] if bag.has(kind) else _candidates(bag, kind)] if names}


def _candidates(bag, kind):
    """Topics that may be meant, the likeliest first, without those of other kinds."""
    taken = {name for other, name in bag.topics.items() if other != kind and bag.has(other)}
    names = [name for name in bag.alternatives(kind) if name not in taken]
    if kind in ("depth", "rgb"):
        names = [name for name in names if _is_depth(bag, name) == (kind == "depth")]
    if kind == "rgb":  # the option takes the name without the transport
        names = [re.sub("/compressed$", "", name) for name in names if not name.endswith("/compressedDepth")]
    image = bag.topics["depth" if kind.startswith("depth") else "rgb"]
    likely = _words(image if kind.endswith("_info") else bag.topics[kind])
    return sorted(dict.fromkeys(names), key=lambda name: (-len(likely & _words(name)), name))


def _is_depth(bag, name):
    try:
        message = bag.first(name)[0]
    except BagError:
        return False
    return getattr(message, "encoding", "") in DEPTH


def _words(name):
    return set(name.strip("/").replace("_", "/").split("/"))


def check_stamps(check, bag, scan, all_without_depth):
    """all_without_depth: whether no bracket finds its depth; wrong stamps are then errors."""
    complain = check.error if all_without_depth else check.warning
    rates = []
    for kind, title in TITLES.items():
        heads, name = getattr(scan, kind), bag.topics[kind]
        stamps = np.array([head.stamp for head in heads], np.int64)
        zero = int((stamps == 0).sum())
        if zero:
            # With equal stamps the nodes keep only the last frame.
            level = check.error if kind == "rgb" and zero == len(stamps) else complain
            level(f"{name}: {zero} of {len(stamps)} stamps are zero: set them in the camera's driver")
            continue
        steps = np.diff(stamps)
        back = np.flatnonzero(steps < 0)
        if len(back):
            check.warning(f"{name}: stamps go back {counted(len(back), 'time')}, by up to {-steps.min() / NS:.3f} "
                          f"s, first after {stamps[back[0]] / NS:.6f}: images out of order, a restarted driver, or "
                          "two recordings in one bag")
        if kind == "rgb" and (steps == 0).any():
            check.warning(f"{name}: {counted(int((steps == 0).sum()), 'image has the stamp')} of the image before: "
                          "set them in the camera's driver")
        if len(steps) and steps.max() > 0:
            rates.append(f"{title} at {NS / np.median(steps[steps > 0]):.3g} Hz")
    delays = {kind: [head.recorded - head.stamp for head in getattr(scan, kind) if head.stamp] for kind in TITLES}
    delays = {kind: float(np.median(times)) / NS for kind, times in delays.items() if times}  # s
    _check_clocks(check, complain, delays)
    late = [f"{TITLES[kind]} recorded {delay:.3f} s after its stamp" for kind, delay in delays.items()]
    check.ok(", ".join(rates + late))


def _check_clocks(check, complain, delays):
    ahead = delays["rgb"] - delays["depth"] if len(delays) == 2 else 0  # s by which colour seems older
    longest = max(delays.values(), key=abs, default=0)
    if abs(ahead) > CLOCKS_APART:
        complain(f"colour is stamped {duration(abs(ahead))} {'earlier' if ahead > 0 else 'later'} than depth, "
                 "compared with the times of recording: the clocks of two machines differ: synchronise them (chrony), or "
                 "correct the stamps")
    elif abs(longest) > ODD_DELAY:
        check.warning(f"images were recorded {duration(abs(longest))} {'after' if longest > 0 else 'before'} their "
                      "stamps: the bag was recorded from another bag, or the clock of a machine is wrong. This "
                      "does no harm to the bag; in live use it would, if tf changes")


def check_depth_in_time(check, brackets, usable, rules):
    """usable: heads of depth images that the nodes do not refuse, one at least."""
    without = [(number, bracket) for number, bracket in enumerate(brackets) if bracket.depth is None]
    if without:
        number, bracket = without[0]
        everywhere = len(without) == len(brackets)
        where = f"{len(without)} of {counted(len(brackets), 'bracket')}, such as bracket {number}"
        (check.error if everywhere else check.warning)(
            f"{where}: no depth image at or before the first frame and not older than {rules.max_age:g} s "
            f"({_nearest(bracket, usable)}): fused by sharpness alone")
        return
    ages = [(bracket.frames[0].head.stamp - bracket.depth.stamp) / NS for bracket in brackets]
    check.ok(f"every bracket has depth, at most {max(ages):.3f} s older than its first frame")


def _nearest(bracket, usable):
    first = bracket.frames[0].head
    gaps = np.array([(first.stamp - head.stamp) / NS for head in usable])
    before = gaps[gaps >= 0]
    if not len(before):
        return f"the first depth comes {duration(-gaps.max())} too late: start the depth camera first"
    age = before.min()
    return f"the newest before it is {duration(age)} old" + (": --label-max-age allows more" if age < OLD else "")


def duration(seconds):
    """0.5 -> 0.5 s, 3612 -> 1:00:12."""
    return f"{seconds:.4g} s" if seconds < 120 else str(timedelta(seconds=round(seconds)))
