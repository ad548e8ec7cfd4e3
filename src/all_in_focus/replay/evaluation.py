# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One evaluation run inside the graph: plays a bag, collects and saves the results, reports the outcome."""
import time
from pathlib import Path

import rospy

from all_in_focus.bag.bag_file import BagContents, BagError, Topics, load_topics
from all_in_focus.files.errors import one_line
from all_in_focus.files.rig import Optics
from all_in_focus.parameters import number, text
from all_in_focus.replay.player import ACKNOWLEDGE, CONNECT, BagPlayer
from all_in_focus.replay.results import DEPTH_RESTORED, ResultFolder, ResultSaver
from all_in_focus.replay.run_status import BAD_INPUT, OK, RunStatus, conclude

STATUS_PERIOD = 0.5  # s


def _path(name):
    """A path, relative to ~working_directory, "" if none is given."""
    return str(Path(text("working_directory"), text(name))) if text(name) else ""


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


def run():
    """Returns the final RunStatus, which is also written to the file ~status, unless that is empty."""
    output, status_file = _path("output"), _path("status")
    reporter = _Reporter(status_file)
    try:
        status = _run(_path("bag"), output, reporter)
    except (ValueError, OSError) as error:
        status = RunStatus(BAD_INPUT, one_line(error, output))
    status.done, status.total = reporter.status.done, reporter.status.total
    status.write(status_file)
    return status


def _run(bag, output, reporter):
    """~optics: f,F,coc, or empty: that of the bag."""
    if not bag or not output:
        raise BagError("the parameters ~bag and ~output are needed")
    optics = Optics.parse(text("optics")) if text("optics") else None
    names = load_topics(_path("topics")) if text("topics") else Topics()
    topics = Topics(**{kind: text(f"{kind}_topic") or name for kind, name in vars(names).items()})
    connect, acknowledge = number("timeout", CONNECT, 0), number("acknowledge_timeout", ACKNOWLEDGE, 0)
    contents = BagContents(bag, topics)
    reporter.status.total = sum(contents.counts.values())
    reporter(0)
    folder = ResultFolder(output)
    try:
        saver = ResultSaver(folder)

        def heartbeat(done):
            reporter(done)
            saver.check()
        player = BagPlayer(contents, connect, acknowledge, heartbeat)
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
    restores = rospy.get_param("fusion/mode", "") == "restored"  # no other mode has that topic
    player.connect({topic: end for topic, end in saver.subscribers.items() if restores or topic != DEPTH_RESTORED})
    if optics or contents.optics:
        player.set_optics(optics or contents.optics)
    player.play(follow_optics=optics is None)
    player.end_bracket(saver.has_saved)
