# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Is everything between the nearest and the farthest depth sharp in some frame of a bracket?"""
import numpy as np

from all_in_focus.bag.check.findings import PerBracket, counted, share_text
from all_in_focus.bag.check.topics import suggestion

NOTICEABLE = 0.02  # share of the known depths


def check_focus_steps(check, brackets, optics, depth):
    """optics: Optics or None; depth: known depths of the scene (mm), as a sample, or empty."""
    told, complaints = [], PerBracket(check, len(brackets))
    for number, bracket in enumerate(brackets):
        distances = np.array([frame.distance for frame in bracket.frames], float) * 1000
        known = distances[~np.isnan(distances)]
        for text in _problems(distances, known, optics, depth):
            complaints.warning(number, text)
        if len(known):
            told.append((known.min(), known.max()))
    complaints.tell()
    if not told:
        check.warning("no focus distances are known: depth and optics have no say in mode refined, sharpness decides "
                      "alone (a table of steps gives them: see docs/dslr.md)")
        return
    near, far = min(low for low, _ in told), max(high for _, high in told)
    check.ok("focused from %.4g to %.4g m%s" % (near / 1000, far / 1000, "" if optics else "; the lens is not known"))


def _problems(distances, known, optics, depth):
    """One line each about one bracket. distances: of all frames, known: those that are not NaN, mm."""
    if not len(known):
        return
    least = optics.focal_length_mm if optics else 0
    if (known <= least).any():
        yield ("%s not beyond the focal length count as unknown, such as %.4g m"
               % (counted(int((known <= least).sum()), "focus distance"), known.min() / 1000))
        known = known[known > least]
    elif len(known) < len(distances):
        yield "%d of %d focus distances are known" % (len(known), len(distances))
    if len(known) > 1:
        yield from _order(known)
    if len(known) and optics:
        yield from _gaps(known, optics, depth)


def _order(known):
    steps = np.diff(1 / known)
    if not steps.any():
        yield "all frames say the same focus distance, %.4g m: does the driver step the focus?" % (known[0] / 1000)
    elif (steps == 0).any():
        yield "%d times a frame has the focus distance of the one before" % (steps == 0).sum()
    elif (steps > 0).any() and (steps < 0).any():
        yield "the focus goes to and fro, not in one sweep: gear backlash makes its distances less certain"


def _gaps(known, optics, depth):
    """Where no frame is sharp: each covers 1/H to either side, in dioptres (1/mm)."""
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
        lying = "" if inside is None else ", where %s of the known depths lie" % share_text(inside)
        yield ("nothing is sharp between %.3g and %.3g m%s: focus there too (segmentation/focus_plan says where)"
               % (begin / 1000, end / 1000, lying))


def check_optics(check, bag, scan, optics, given, nearest):
    """optics: of the bag or None; given: at the command line; nearest: known depth in mm, or None."""
    if scan.optics and optics is None and not given:
        message = scan.optics[0].message
        check.warning("%s: impossible (f = %g, F = %g, circle of confusion %g): the nodes keep their default of 24, 4, "
                      "0.019; give --optics f,F,coc" % (bag.topics["optics"], message.focal_length_mm, message.aperture,
                                                        message.circle_of_confusion_mm))
    elif optics is None and not given:
        check.warning("%s: the nodes take their default, f = 24 mm, F = 4, circle of confusion 0.019 mm: give --optics "
                      "f,F,coc, or optics.yaml to make_bag"
                      % "; ".join(filter(None, ["nothing on " + bag.topics["optics"], suggestion(bag, "optics")])))
    lens = given or optics
    if lens and nearest is not None and nearest <= lens.focal_length_mm:
        check.error("the focal length of %g mm is not below the nearest depth, %g mm: is one of them in another unit?"
                    % (lens.focal_length_mm, nearest))
    if lens:
        check.ok("f = %g mm, F = %g, circle of confusion %g mm%s"
                 % (*vars(lens).values(), ", as given" if given else ""))
