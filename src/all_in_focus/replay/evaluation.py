# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One evaluation run inside the graph: plays a bag, collects and saves the results, reports the outcome."""
import json
import math
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import List, Optional

import rospy

from all_in_focus.bag.bag_file import BagContents, BagError, Topics, load_topics
from all_in_focus.files.errors import counted, one_line
from all_in_focus.files.output_file import write_json
from all_in_focus.files.rig import Optics
from all_in_focus.parameters import number, text
from all_in_focus.replay.player import ACKNOWLEDGE, CONNECT, BagPlayer
from all_in_focus.replay.results import DEPTH_RESTORED, ResultFolder, ResultSaver

OK, BAD_INPUT = 0, 2  # exit codes
STATUS_PERIOD = 0.5  # s


@dataclass
class RunStatus:
    """State of a run, in a small file that evaluate_bag watches. code: None while it goes on; reason: one line; done of total:
    messages played."""
    code: Optional[int] = None
    reason: str = "running"
    warnings: List[str] = field(default_factory=list)
    done: int = 0
    total: int = 0

    def write(self, path):
        """Replaces the file in one step, so that nobody reads half of it; does nothing without a path."""
        if path:
            write_json(path, asdict(self))

    @classmethod
    def read(cls, path):
        """None while there is no file."""
        try:
            return cls(**json.loads(Path(path).read_text(encoding="utf-8")))
        except FileNotFoundError:
            return None


def conclude(reports, missing, warnings):
    """Exit code and reason of a run. missing: topics of outputs that never came, by the number of the bracket; warnings: of the
    nodes and the player, worst first."""
    why = ": " + warnings[0] if warnings else ""
    if missing:
        number = min(missing)
        return BAD_INPUT, f"{ResultFolder.name(number)}: {', '.join(missing[number])} never came"
    fused = [report for report in reports if report.frames_used > 0]
    if not fused:
        notes = [note for report in reports for note in report.notes]
        return BAD_INPUT, "no bracket was fused" + (f": {notes[0]}" if notes else why)
    # Of large images the fusion may have dropped the labels, and the regions with them. A bag without depth is refused before:
    # fusing by sharpness alone was not asked for.
    if not any(any(choice.label > 0 for choice in report.segments) or not (report.has_labels or report.sharpness_alone)
               for report in fused):
        return BAD_INPUT, f"no region came of the bag's depth{why}"
    unfused = len(reports) - len(fused)
    return OK, f"{counted(len(fused), 'bracket')} fused" + (f", {unfused} could not be" if unfused else "")


def _path(name):
    """A path, relative to ~working_directory, "" if none is given."""
    return str(Path(text("working_directory"), text(name))) if text(name) else ""


def run():
    """Returns the final RunStatus, which is also written to the file ~status, unless that is empty."""
    output, file, status = _path("output"), _path("status"), RunStatus()
    try:
        status.code, status.reason = _run(_path("bag"), output, status, file)
    except (ValueError, OSError) as error:
        status.code, status.reason = BAD_INPUT, one_line(error, output)
    status.write(file)
    return status


def _run(bag, output, status, file):
    """(exit code, reason). status: is kept up to date, and in `file`. ~optics: f,F,coc, or empty: that of the bag."""
    if not bag or not output:
        raise BagError("the parameters ~bag and ~output are needed")
    optics = Optics.parse(text("optics")) if text("optics") else None
    names = load_topics(_path("topics")) if text("topics") else Topics()
    topics = Topics(**{kind: text(f"{kind}_topic") or name for kind, name in vars(names).items()})
    connect, acknowledge = number("timeout", CONNECT, 0), number("acknowledge_timeout", ACKNOWLEDGE, 0)
    contents = BagContents(bag, topics)
    status.total, written = sum(contents.counts.values()), -math.inf
    folder = ResultFolder(output)
    try:
        saver = ResultSaver(folder)

        def heartbeat(done):
            nonlocal written
            status.done = done
            if time.monotonic() > written + STATUS_PERIOD:
                status.write(file)
                written = time.monotonic()
            saver.check()
        heartbeat(0)
        player = BagPlayer(contents, connect, acknowledge, heartbeat)
        _play(contents, player, saver, optics)
        problems = [f"{text} ({times} times)" if times > 1 else text for text, times in player.problems.items()]
        reports, missing = saver.finish()
        status.warnings = saver.complaints() + problems + contents.problems
        code, reason = conclude(reports, missing, status.warnings)
        if code == OK:
            folder.commit()
        return code, reason
    finally:
        folder.discard()
        contents.close()


def _play(contents, player, saver, optics):
    restores = rospy.get_param("fusion/mode", "") == "restored"  # no other mode has that topic
    player.connect({topic: end for topic, end in saver.subscribers.items() if restores or topic != DEPTH_RESTORED})
    if optics or contents.optics:
        player.set_optics(optics or contents.optics)
    player.play(follow_optics=optics is None)
    player.end_bracket(saver.has_saved)
