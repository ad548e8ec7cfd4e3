# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What are the brackets, do their focus messages agree, and is every depth of the scene sharp in some frame?"""
import numpy as np

from all_in_focus.bag.check.findings import share_text
from all_in_focus.bag.check.recording import suggestion
from all_in_focus.bag.scan import NS
from all_in_focus.files.errors import counted
from all_in_focus.files.rig import DEFAULT_OPTICS

NOTICEABLE = 0.02  # share of the known depths


def check_brackets(check, bag, scan, assembled, rules):
    brackets = assembled.found
    if not brackets:
        if scan.focus and len(assembled.unpaired) == len(scan.rgb):
            check.error(f"no colour image has a message of the same stamp on {bag.topics['focus']}: stamp them "
                        "alike, or leave them out (--focus-topic /none)")
        else:
            check.error("no bracket has its beginning (index 0) in the bag: start the recording before the bracket")
        return
    if scan.focus:
        _check_focus_messages(check, bag, scan, assembled)
    else:
        other = suggestion(bag, "focus")
        if other:
            check.warning(f"nothing on {bag.topics['focus']}; {other}")
    single = [number for number, bracket in enumerate(brackets) if len(bracket.frames) == 1]
    if single:
        remedy = "" if scan.focus else (": --bracket-gap or --bracket-size says where one ends (these ended by gaps "
                                        f"longer than {rules.gap:g} s)")
        which = "all brackets are" if len(single) == len(brackets) else counted(len(single), "bracket")
        check.warning(f"{which} of one frame only, the first is bracket {single[0]}{remedy}")
    frames = [len(bracket.frames) for bracket in brackets]
    lengths = str(frames[0]) if min(frames) == max(frames) else f"{min(frames)} to {max(frames)}"
    kind = "by focus messages" if scan.focus else f"{rules.size} frames each" if rules.size \
        else f"ended by gaps longer than {rules.gap:g} s" if rules.gap else "not ended by anything"
    check.ok(f"{counted(len(brackets), 'bracket')} of {lengths} frames, {kind}", len(brackets))


def _check_focus_messages(check, bag, scan, assembled):
    name = bag.topics["focus"]
    for stamps, text in (
            ([head.stamp for head in assembled.unpaired],
             f"of {len(scan.rgb)} colour images have no message of the same stamp on {name} and are left out"),
            ([message.header.stamp.to_nsec() for message in assembled.stray],
             f"of {len(scan.focus)} messages on {name} have no image of the same stamp"),
            ([head.stamp for head in assembled.refused],
             f"of {len(scan.rgb)} colour images came twice or too late, or their bracket began before the recording")):
        if stamps:
            check.warning(f"{len(stamps)} {text}, the first of stamp {stamps[0] / NS:.6f}")
    for number, bracket in enumerate(assembled.found):
        for text in _inconsistent(bracket):
            check.bracket_warning(number, text)


def _inconsistent(bracket):
    """Contradictions among the FocusFrames of one bracket."""
    missing = bracket.missing
    if missing:
        yield (f"{len(missing)} of {len(missing) + len(bracket.frames)} frames are missing, the first is {missing[0]}")
    counts = sorted({frame.focus.count for frame in bracket.frames})
    if len(counts) > 1:
        yield f"count is {' and '.join(map(str, counts[:3]))}"
    if not missing and not bracket.frames[-1].focus.last and not bracket.announced:
        yield "no frame says last and count is 0: it ends only when the next begins"


def check_focus_steps(check, brackets, optics, depth):
    """optics: Optics or None; depth: known depths of the scene (mm), as a sample, or empty."""
    ranges = []
    for number, bracket in enumerate(brackets):
        distances = np.array([frame.distance for frame in bracket.frames], float) * 1000
        known = distances[~np.isnan(distances)]
        for text in _problems(distances, known, optics, depth):
            check.bracket_warning(number, text)
        if len(known):
            ranges.append((known.min(), known.max()))
    if not ranges:
        check.warning("no focus distances are known: depth and lens data are not used in mode refined, sharpness decides "
                      "alone (a table of steps gives them: see docs/dslr.md)")
        return
    near, far = min(low for low, _ in ranges), max(high for _, high in ranges)
    check.ok(f"focused from {near / 1000:.4g} to {far / 1000:.4g} m{'' if optics else '; the lens is not known'}", len(brackets))


def _problems(distances, known, optics, depth):
    """One line for each problem of one bracket. distances: of all frames, known: those that are not NaN, mm."""
    if not len(known):
        return
    least = optics.focal_length_mm if optics else 0
    known = known[known > least]
    if len(known) < len(distances):
        yield f"{len(distances) - len(known)} of {len(distances)} focus distances are unknown, or not beyond the focal length"
    steps = np.diff(1 / known)
    if (steps == 0).any():
        yield f"{(steps == 0).sum()} of {len(steps)} steps leave the focus distance as it is: does the driver step the focus?"
    elif (steps > 0).any() and (steps < 0).any():
        yield "the focus goes to and fro, not in one sweep: gear backlash makes its distances less certain"
    if len(known) and optics:
        yield from _gaps(known, optics, depth)


def _gaps(known, optics, depth):
    """Ranges where no frame is sharp. Each frame is sharp within 1/H to either side, in dioptres (1/mm)."""
    f = optics.focal_length_mm
    reach = optics.aperture * optics.circle_of_confusion_mm / (f * f)
    at = np.sort(1 / known)[::-1]  # near to far
    gaps = [(1 / (a - reach), 1 / (b + reach)) for a, b in zip(at, at[1:]) if a - reach > b + reach]
    if len(depth):
        low, high = np.percentile(depth, [1, 99])
        if 1 / low > at[0] + reach:
            gaps.insert(0, (low, 1 / (at[0] + reach)))
        if 1 / high < at[-1] - reach:
            gaps.append((1 / (at[-1] - reach), high))
    for begin, end in sorted(gaps, key=lambda gap: 1 / gap[1] - 1 / gap[0])[:2]:
        inside = float(((depth >= begin) & (depth <= end)).mean()) if len(depth) else None
        if inside is not None and inside < NOTICEABLE:
            continue
        lying = "" if inside is None else f", where {share_text(inside)} of the known depths lie"
        yield (f"nothing is sharp between {begin / 1000:.3g} and {end / 1000:.3g} m{lying}: focus there too "
               "(segmentation/focus_plan says where)")


def check_optics(check, bag, scan, optics, given, nearest, warning):
    """optics: of the bag or None; given: at the command line; nearest: known depth in mm, or None; warning: of the
    circle of confusion, or empty."""
    reason = "; ".join(filter(None, [f"nothing on {bag.topics['optics']}", suggestion(bag, "optics")]))
    if scan.optics:
        reason = f"{bag.topics['optics']}: impossible ({_lens_text(scan.optics[0].message)})"
    lens = given or optics
    if lens is None:
        check.warning(f"{reason}: the nodes take their default, {_lens_text(DEFAULT_OPTICS)}: give --optics f,F,coc")
    if lens and nearest is not None and nearest <= lens.focal_length_mm:
        check.error(f"the focal length of {lens.focal_length_mm:g} mm is not below the nearest depth, {nearest:g} "
                    "mm: is one of them in another unit?")
    if warning:
        check.warning(warning)
    if lens:
        check.ok(f"{_lens_text(lens)}{', as given' if given else ''}")


def _lens_text(lens):
    return (f"f = {lens.focal_length_mm:g} mm, F = {lens.aperture:g}, circle of confusion "
            f"{lens.circle_of_confusion_mm:g} mm")
