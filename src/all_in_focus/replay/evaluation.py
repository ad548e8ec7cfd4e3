# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One evaluation run inside the graph: plays a bag, collects and saves the results, reports the outcome."""
import time
from dataclasses import dataclass, field
from pathlib import Path

import rospy

from all_in_focus.bag.contents import BagContents, BagError, Topics
from all_in_focus.files.errors import one_line
from all_in_focus.files.rig import Optics
from all_in_focus.replay.player import BagPlayer, Limits, PlayError
from all_in_focus.replay.results import ResultError, ResultFolder, ResultSaver
from all_in_focus.replay.run_status import BAD_INPUT, OK, RunStatus, conclude

STATUS_PERIOD = 0.5  # s


@dataclass
class Settings:
    """bag, output: paths; status: file for the RunStatus, or empty; optics: f,F,coc, or empty: that of the bag."""
    bag: str
    output: str
    status: str = ""
    optics: str = ""
    topics: Topics = field(default_factory=Topics)
    limits: Limits = field(default_factory=Limits)

    @classmethod
    def from_parameters(cls):
        """Private parameters of this node; paths are relative to ~working_directory."""
        def text(name, default=""):
            return str(rospy.get_param(f"~{name}", default))

        def path(name):
            return str(Path(text("working_directory"), text(name))) if text(name) else ""

        topics = Topics(**{kind: text(f"{kind}_topic", default) or default for kind, default in vars(Topics()).items()})
        limits = Limits(connect=float(rospy.get_param("~timeout", Limits.connect)),
                        acknowledge=float(rospy.get_param("~acknowledge_timeout", Limits.acknowledge)))
        return cls(path("bag"), path("output"), path("status"), text("optics"), topics, limits)


class _Reporter:
    """Writes the status file while the run goes on."""

    def __init__(self, path):
        self._path = path
        self._due = 0.0
        self.status = RunStatus(reason="running")

    def __call__(self, done):
        self.status.done = done
        if time.monotonic() >= self._due:
            self.status.write(self._path)
            self._due = time.monotonic() + STATUS_PERIOD


def run(settings):
    """Returns the final RunStatus, which is also written to the status file."""
    reporter = _Reporter(settings.status)
    try:
        status = _run(settings, reporter)
    except (BagError, PlayError, ResultError) as error:
        status = RunStatus(BAD_INPUT, str(error))
    except OSError as error:
        status = RunStatus(BAD_INPUT, one_line(error, settings.output))
    status.done, status.total = reporter.status.done, reporter.status.total
    status.write(settings.status)
    return status


def _run(settings, reporter):
    if not settings.bag or not settings.output:
        raise BagError("the parameters ~bag and ~output are needed")
    try:
        optics = Optics.parse(settings.optics) if settings.optics else None
    except ValueError as error:
        raise BagError(str(error))
    contents = BagContents(settings.bag, settings.topics)
    reporter.status.total = sum(contents.counts.values())
    reporter(0)
    folder = ResultFolder(settings.output)
    try:
        saver = ResultSaver(folder)
        player = BagPlayer(contents, settings.limits, reporter)
        _play(contents, player, saver, optics)
        problems = [f"{text} ({times} times)" if times > 1 else text for text, times in player.problems.items()]
        status = conclude(saver.finish(), saver.complaints() + problems + contents.problems)
        if status.code == OK:
            folder.commit()
        return status
    finally:
        folder.discard()
        contents.close()


def _play(contents, player, saver, optics):
    def check():
        if saver.error:
            raise ResultError(saver.error)

    player.connect(saver.subscribers)
    if optics or contents.optics:
        player.set_optics(optics or contents.optics)
    player.play(follow_optics=optics is None, check=check)

    def all_saved(published):
        reports, waiting = saver.progress()
        return saver.error or reports >= published and not waiting

    player.end_bracket(all_saved)
    check()
