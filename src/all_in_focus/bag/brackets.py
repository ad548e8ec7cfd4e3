# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assigns the frames of a bag to brackets and a depth image to each bracket, as the fusion node does."""
import math
from dataclasses import dataclass, field
from typing import List, Optional

from all_in_focus.bag.scan import NS, Head

MAX_FRAMES = 65535
JITTER_NS = NS // 10  # stamps that go back by less are no time jump
# evaluate_bag's player sends up to so many frames before it waits for an acknowledgement. So depth that was recorded
# no more than so many frames after the first frame of a bracket can still be used for it.
WINDOW = 8


@dataclass
class Rules:
    """size: frames in a bracket, 0 = unknown; gap: s that end a bracket, 0 = never; both only where there is no
    focus topic. max_age: of the depth image, s."""
    size: int = 0
    gap: float = 1.0
    max_age: float = 1.0


@dataclass
class Frame:
    """index: in its bracket; focus: its FocusFrame, or None."""
    head: Head
    index: int
    focus: Optional[object] = None

    @property
    def distance(self):
        """m, NaN = unknown."""
        return self.focus.focus_distance if self.focus else math.nan


@dataclass
class Bracket:
    """number: bracket_id of its messages, or counted; announced: how many frames it should have, 0 = unknown; depth:
    the newest depth image at or before its first frame, None where none is young enough."""
    number: int
    announced: int = 0
    frames: List[Frame] = field(default_factory=list)
    depth: Optional[Head] = None

    @property
    def missing(self):
        """Indices that were announced and are not there."""
        present = {frame.index for frame in self.frames}
        return [index for index in range(max(self.announced, max(present) + 1)) if index not in present]


@dataclass
class Brackets:
    """found: in order; unpaired: heads of frames without a focus message of the same stamp; stray: focus messages
    without a frame; refused: frames of brackets whose beginning is missing, and frames that come twice."""
    found: List[Bracket]
    unpaired: List[Head]
    stray: List[object]
    refused: List[Head]


def assemble(scan, rules, usable_depth):
    """Brackets of a Scan. usable_depth: heads of the depth images that the nodes do not refuse."""
    if scan.focus:
        pairs, unpaired, stray = _pair(scan)
        found, refused = _by_focus(pairs, {focus.bracket_id for focus in stray if focus.index == 0})
    else:
        found, unpaired, stray, refused = _by_gap(scan.rgb, rules), [], [], []
    places = {head.order: place for place, head in enumerate(scan.rgb)}
    for bracket in found:
        first = bracket.frames[0].head
        end = places[first.order] + WINDOW
        later = scan.rgb[end:end + 1]
        in_time = [head for head in usable_depth if (not later or head.order < later[0].order)
                   and 0 <= first.stamp - head.stamp <= rules.max_age * NS]
        bracket.depth = max(in_time, key=lambda head: head.stamp, default=None)
    return Brackets(found, unpaired, stray, refused)


def _pair(scan):
    """(pairs of head and FocusFrame of equal stamps, in the order of their completion; heads left over; messages left
    over)."""
    waiting_heads, waiting_focus, pairs = {}, {}, []
    for item in sorted([*scan.rgb, *scan.focus], key=lambda item: item.order):
        is_head = isinstance(item, Head)
        stamp = item.stamp if is_head else item.message.header.stamp.to_nsec()
        own, other = (waiting_heads, waiting_focus) if is_head else (waiting_focus, waiting_heads)
        if other.get(stamp):
            partner = other[stamp].pop(0)
            pairs.append((item, partner.message) if is_head else (partner, item.message))
        else:
            own.setdefault(stamp, []).append(item)
    unpaired = [head for heads in waiting_heads.values() for head in heads]
    return pairs, unpaired, [small.message for smalls in waiting_focus.values() for small in smalls]


def _by_focus(pairs, announced):
    """Brackets of frames with focus messages: does what src/nodelets/fusion/bracket_assembler.cpp does. announced: numbers of
    brackets whose first frame has lost its picture only."""
    brackets, refused, is_open, skipped = [], [], False, None
    for head, focus in pairs:
        same = bool(brackets) and focus.bracket_id == brackets[-1].number
        # The bracket began before the recording.
        unseen = not brackets and skipped is None and focus.bracket_id not in announced
        late = same and (not is_open or focus.index <= brackets[-1].frames[-1].index)
        if focus.index >= MAX_FRAMES or focus.index and (unseen or focus.bracket_id == skipped or late):
            skipped = focus.bracket_id if unseen else skipped
            refused.append(head)
            continue
        skipped = None
        # The same number starting at index 0 again is another bracket.
        if not is_open or not same or focus.index == 0:
            brackets.append(Bracket(focus.bracket_id))
        bracket = brackets[-1]
        bracket.frames.append(Frame(head, focus.index, focus))
        bracket.announced = focus.count
        is_open = not (focus.last or focus.count and focus.index + 1 >= focus.count)
    return brackets, refused


def _by_gap(heads, rules):
    brackets = []
    for head in heads:
        frames = brackets[-1].frames if brackets else []
        if (not frames or 0 < rules.size <= len(frames) or len(frames) >= MAX_FRAMES
                or head.stamp + JITTER_NS < frames[-1].head.stamp
                or 0 < rules.gap * NS < head.stamp - frames[-1].head.stamp):
            brackets.append(Bracket(len(brackets), rules.size))
        brackets[-1].frames.append(Frame(head, len(brackets[-1].frames)))
    return brackets
