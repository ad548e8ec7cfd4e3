# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Is everything recorded that the nodes need, under these names, and where else if not?"""
import os
import re

from all_in_focus.bag.file import REQUIRED, BagError
from all_in_focus.bag.images import METRES, MILLIMETRES
from all_in_focus.bag.options import option_of
from all_in_focus.bag.check.findings import counted

DEPTH = (*MILLIMETRES, METRES)
TRANSPORTS = ("compressedDepth", "compressed", "theora")  # that nothing here reads (of colour, compressed is)


def check_file(check, bag):
    start, end = bag.span()
    compression = "" if bag.compression() == "none" else ", " + bag.compression()
    check.ok("%.1f MB%s, %.1f s" % (os.path.getsize(bag.path) / 1e6, compression, end - start))


def check_topics(check, bag, scan):
    for kind in bag.missing():
        check.error("no %s: %s" % (REQUIRED[kind], "; ".join(_where(bag, kind))))
    for kind, problem in bag.wrong_types():
        remedy = suggestion(bag, kind)
        if "another version" in problem:
            remedy = "record it again, or rosbag fix"
        check.error(problem + (": " + remedy if remedy else ""))
    broken = [kind for kind, _ in scan.unreadable if kind not in ("depth", "rgb")]  # images: see check_images()
    for kind in sorted(set(broken)):
        check.warning("%s: %s cannot be read"
                      % (bag.topics.get(kind, "/" + kind), counted(broken.count(kind), "message")))
    names = [bag.topics[kind] for kind in REQUIRED]
    remark = " (compressed colour: decoded frame by frame)" if names[2].endswith("/compressed") else ""
    check.ok("%s%s" % (", ".join("%s %d" % (name, bag.found[name].message_count) if bag.has_topic(name) else name
                                 for name in names), remark))


def _where(bag, kind):
    """Parts of a line: what is missing, what may be meant."""
    name = bag.topics[kind]
    yield "nothing on %s" % name
    for ending in TRANSPORTS:
        if bag.has_topic("%s/%s" % (name, ending)):
            yield ("%s/%s cannot be read: rosrun image_transport republish %s in:=%s raw out:=%s, and record that"
                   % (name, ending, ending, name, name))
    other = suggestion(bag, kind)
    if other:
        yield other


def suggestion(bag, kind):
    """Which topic may be meant where the expected one is not there, and how to say so; empty if there is none."""
    names = _candidates(bag, kind)
    if not names:
        return ""
    if len(names) == 1:
        return "%s has that type: %s %s" % (names[0], option_of(kind), names[0])
    return "%s of that type (%s): such as %s %s" % (counted(len(names), "topic"), ", ".join(names[:5]),
                                                    option_of(kind), names[0])


def _candidates(bag, kind):
    """Topics that may be meant, the likeliest first; none that another kind has already."""
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
