# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What are the brackets, and are their focus messages those of their frames?"""
from all_in_focus.bag.check.findings import PerBracket, counted
from all_in_focus.bag.check.topics import suggestion
from all_in_focus.bag.scan import NS


def check_brackets(check, bag, scan, assembled, rules):
    brackets = assembled.found
    if not brackets:
        if scan.focus and len(assembled.unpaired) == len(scan.rgb):
            check.error("no colour image has a message of the same stamp on %s: stamp them alike, or leave them out "
                        "(--focus-topic /none)" % bag.topics["focus"])
        else:
            check.error("no bracket has its beginning (index 0) in the bag: start the recording before the bracket")
        return
    if scan.focus:
        _check_focus_messages(check, bag, scan, assembled)
    else:
        other = suggestion(bag, "focus")
        if other:
            check.warning("nothing on %s; %s" % (bag.topics["focus"], other))
    single = [number for number, bracket in enumerate(brackets) if len(bracket.frames) == 1]
    if single:
        remedy = "" if scan.focus else ": --bracket-gap or --bracket-size says where one ends (these ended by gaps " \
            "longer than %g s)" % rules.gap
        check.warning("%s of one frame only, the first is bracket %d%s"
                      % ("all brackets are" if len(single) == len(brackets) else counted(len(single), "bracket"),
                         single[0], remedy))
    frames = [len(bracket.frames) for bracket in brackets]
    told = "%d" % frames[0] if min(frames) == max(frames) else "%d to %d" % (min(frames), max(frames))
    kind = "by focus messages" if scan.focus else "%d frames each" % rules.size if rules.size \
        else "ended by gaps longer than %g s" % rules.gap
    check.ok("%s of %s frames, %s" % (counted(len(brackets), "bracket"), told, kind))


def _check_focus_messages(check, bag, scan, assembled):
    name = bag.topics["focus"]
    if assembled.unpaired:
        check.warning("%d of %d colour images have no message of the same stamp on %s and are left out, the first of "
                      "stamp %.6f" % (len(assembled.unpaired), len(scan.rgb), name, assembled.unpaired[0].stamp / NS))
    if assembled.stray:
        check.warning("%d of %d messages on %s have no image of the same stamp, the first of stamp %.6f"
                      % (len(assembled.stray), len(scan.focus), name, assembled.stray[0].header.stamp.to_sec()))
    if assembled.refused:
        check.warning("%s left out: come twice, too late, or their bracket began before the recording; the first of "
                      "stamp %.6f" % (counted(len(assembled.refused), "image"), assembled.refused[0].stamp / NS))
    per_bracket = PerBracket(check, len(assembled.found))
    for number, bracket in enumerate(assembled.found):
        for text in _inconsistent(bracket):
            per_bracket.warning(number, text)
    per_bracket.tell()


def _inconsistent(bracket):
    """What FocusFrames of one bracket contradict."""
    missing = bracket.missing
    if missing:
        yield ("%d of %d frames are missing, the first is %d"
               % (len(missing), len(missing) + len(bracket.frames), missing[0]))
    counts = sorted({frame.focus.count for frame in bracket.frames})
    if len(counts) > 1:
        yield "count is %s" % " and ".join(map(str, counts[:3]))
    early = [frame.index for frame in bracket.frames[:-1] if frame.focus.last]
    if early:
        yield "frame %d says last, others follow" % early[0]
    if not missing and not bracket.frames[-1].focus.last and not bracket.announced:
        yield "no frame says last and count is 0: it ends only when the next begins"
