# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Do the nodes take these images: encoding, layout, size."""
from collections import Counter

from all_in_focus.bag.check.findings import counted
from all_in_focus.bag.images import ImageError, bgr, check_color, check_depth
from all_in_focus.bag.scan import NS, fetch


def check_images(check, bag, scan, kind):
    """Returns the heads of the images that the nodes take. kind: "depth" or "rgb"."""
    heads, name = getattr(scan, kind), bag.topics[kind]
    problems = _problems(bag, scan, kind)
    good = [head for head in heads if head.order not in problems]
    broken = [time for which, time in scan.unreadable if which == kind]
    if broken:
        check.warning("%s: %s cannot be read, the first recorded at %.3f s"
                      % (name, counted(len(broken), "message"), (broken[0] - scan.start) / NS))
    for text, number in Counter(problems.values()).most_common(3):
        if not good:
            check.error("%s: %s" % (name, text))
        else:
            first = next(head for head in heads if problems.get(head.order) == text)
            check.warning("%s: %d of %d images, the first at %.3f s: %s"
                          % (name, number, len(heads), (first.recorded - scan.start) / NS, text))
    if not heads:
        check.error("%s: no image can be read" % name)
    sizes = Counter(head.size for head in good)
    if len(sizes) > 1:
        check.warning("%s: sizes differ (%s): what is not like the first of a bracket is left out"
                      % (name, ", ".join("%dx%d: %d" % (*size, number) for size, number in sizes.most_common())))
    encodings = sorted({head.encoding for head in good})
    for encoding in encodings:
        if encoding.startswith("bayer_"):
            check.warning("%s: %s is interpolated in the plainest way: rather record what image_proc's debayer makes "
                          "of it" % (name, encoding))
    if good:
        size = "%dx%d " % good[0].size if good[0].size else ""
        check.ok("%s, %s%s" % (counted(len(heads), "image"), size, ", ".join(encodings)))
    return good


def _problems(bag, scan, kind):
    """Why the nodes refuse an image, by its order in the bag."""
    problems = {}
    conversions = {}  # problem or None, by encoding: tried once each, reading all pixels would take long
    for head in getattr(scan, kind):
        try:
            if kind == "depth":
                check_depth(head)
                continue
            check_color(head)
            if head.encoding not in conversions:
                conversions[head.encoding] = _conversion(bag, head)
            if conversions[head.encoding]:
                problems[head.order] = conversions[head.encoding]
        except ImageError as error:
            problems[head.order] = str(error)
    return problems


def _conversion(bag, head):
    try:
        bgr(fetch(bag, "rgb", head))
    except ImageError as error:
        return "encoding %s: %s" % (head.encoding, error)
    return None
