# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Runs evaluate.launch on a master of its own, with a time-out and an exit code, which roslaunch has not."""
import json
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import List, Optional

import rospkg

from all_in_focus.files.errors import counted
from all_in_focus.files.output_file import write_json
from all_in_focus.files.output_folder import remove_leftovers
from all_in_focus.progress import Progress
from all_in_focus.replay.launch import Launch
from all_in_focus.replay.results import ResultFolder

OK, BAD_INPUT = 0, 2  # exit codes


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


def _launch_file():
    """RuntimeError where this package cannot be found."""
    try:
        return Path(rospkg.RosPack().get_path("all_in_focus")) / "launch" / "evaluate.launch"
    except rospkg.ResourceNotFound as error:
        raise RuntimeError(f"package {str(error).splitlines()[0]} is missing: build it, and source its build/.install/setup.bash")


def run(arguments, output, timeout, verbose=False):
    """Runs evaluate.launch. arguments: its args by name; timeout: s without progress. Returns the final RunStatus."""
    launch_file = _launch_file()
    with tempfile.TemporaryDirectory(prefix="evaluate_bag.") as scratch:
        status_file = Path(scratch) / "status.json"
        arguments = [f"{name}:={value}" for name, value in {**arguments, "status": status_file}.items()]
        with Launch(Path(scratch) / "log", [launch_file], arguments, verbose=verbose) as launch:
            stopped_because = _watch(launch, status_file, timeout)
        status = final_status(RunStatus.read(status_file), stopped_because, launch.reason())
    if status.code != 0:
        remove_leftovers(output)  # of a killed player
    return status


def final_status(status, stopped_because, ended_because):
    """RunStatus of an ended run. status: the player's last, or None; stopped_because: by the watchdog, or None;
    ended_because: the node whose end has ended the others, or None."""
    final = status is not None and status.code is not None
    if final and not stopped_because and not (ended_because and "from outside" in status.reason):
        return status
    reason = stopped_because or "the run ended before the bag was played"
    return RunStatus(BAD_INPUT, f"{reason}: {ended_because}" if ended_because else reason)


def _watch(launch, status_file, timeout):
    """Returns when the run is over: None, or the reason to stop it."""
    last, changed = None, time.monotonic()
    with Progress(unit="message") as bar:
        while not launch.ended():
            status = RunStatus.read(status_file)
            if status is not None and status.code is not None:
                return None  # not waiting for the nodes to end
            if status is not None:
                bar.total = status.total
                bar.update(status.done - bar.n)
            stamp = status_file.stat().st_mtime_ns if status is not None else None
            if stamp != last:
                last, changed = stamp, time.monotonic()
            if time.monotonic() - changed > timeout:
                return f"no progress for {timeout:g} s"
            time.sleep(0.1)
    return None
