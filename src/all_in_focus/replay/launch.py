# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""roslaunch on a ROS master of its own, whose end is told and leaves no process behind."""
import os
import re
import signal
import socket
import subprocess
import sys
from contextlib import AbstractContextManager, suppress
from pathlib import Path

GRACE = (5, 3)  # s between SIGINT, SIGTERM and SIGKILL to a node that does not end
SHUTDOWN, AT_ONCE = sum(GRACE) + 6, 2  # s; what is left then, after an error AT_ONCE, is killed: below command_line.LONGEST_END
# What roslaunch prints
COLOUR_OR_TITLE = re.compile(r"\x1b(?:\[[0-9;]*m|\][^\x07]*\x07)")
DEATH = re.compile(r"\[(\S+?)(?:-\d+)?\](?: has died!\n| )process has (?:died \[pid \d+, exit code (-?\d+),|finished cleanly)")
FAILURE = re.compile(r"(cannot launch node .*)|(?:RLException|Resource not found|Value error): ([\s\S]*?)\nThe traceback")


def free_port():
    """No program that asks for any port gets this one until this process ends: a copy of the socket holds it."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # so that the master, which sets this, too, can listen
        probe.bind(("localhost", 0))
        os.dup(probe.fileno())
        return probe.getsockname()[1]


def own_master(log_folder):
    """Environment of nodes with a master of their own: the distribution's Python first."""
    return {"ROS_MASTER_URI": f"http://localhost:{free_port()}", "ROS_HOSTNAME": "localhost", "ROS_NAMESPACE": "/",
            "ROS_LOG_DIR": str(log_folder), "PYTHONUNBUFFERED": "1", "PATH": f"/usr/bin:/bin:{os.environ.get('PATH', '')}"}


class Launch(AbstractContextManager):
    """roslaunch at work. At the end of the block, or of this process, its nodes end, then the master if it has started that."""

    def __init__(self, folder, *arguments, verbose=False, grace=GRACE):
        """folder: gets stdout and stderr of roslaunch and the nodes; verbose: repeats both on stderr; grace: see GRACE."""
        files = [Path(folder, name) for name in ("stdout", "stderr")]
        self._mark = f"ALL_IN_FOCUS_LAUNCH={Path(folder).resolve()}"
        with open(files[0], "wb") as stdout, open(files[1], "wb") as stderr:
            self._process = subprocess.Popen(
                ["setpriv", "--pdeathsig", "INT", "roslaunch", f"--sigint-timeout={grace[0]}", f"--sigterm-timeout={grace[1]}",
                 *map(str, arguments)], stdin=subprocess.DEVNULL, stdout=stdout, stderr=stderr, start_new_session=True,
                env=dict([*os.environ.items(), self._mark.split("=", 1)]))
        self._verbose, self._printed = verbose, {open(file, encoding="utf-8", errors="replace"): "" for file in files}

    def _read(self):
        """All that has come on stdout and on stderr so far."""
        for file in self._printed:
            new = file.read()
            if self._verbose:
                sys.stderr.write(new)
            self._printed[file] += new
        return [COLOUR_OR_TITLE.sub("", text) for text in self._printed.values()]

    def deaths(self):
        """(exit code, one line) of each process that has ended by itself, in their order."""
        text = self._read()[1]
        return [(int(death[2] or 0), _ended(death[1], int(death[2] or 0), text[:death.start()].rpartition("\n")[0]))
                for death in DEATH.finditer(text)]

    def reason(self):
        """Why it has ended, or will not do its work; one line. None while all is well."""
        code, deaths, text = self._process.poll(), self.deaths(), self._read()[1]
        ended = [] if code is None else [_ended("roslaunch", code, text)]
        reasons = [reason for died, reason in deaths if died]
        reasons += [" ".join((one[1] or one[2]).split()) for one in FAILURE.finditer(text)]
        reasons += [*(ended if (code or 0) < 0 else []), *(reason for _, reason in deaths), *ended]
        return reasons[0] if reasons else None

    def close(self, patience=SHUTDOWN):
        self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for process in Path("/proc").glob("[0-9]*"):  # roslaunch leaves nodes if it is killed, or ended while it starts them
            with suppress(OSError):
                if self._mark.encode() in (process / "environ").read_bytes().split(b"\0"):
                    os.kill(int(process.name), signal.SIGKILL)
        self._read()
        for file in self._printed:
            file.close()

    def __exit__(self, error, *_):
        self.close(AT_ONCE if error else SHUTDOWN)  # a roslaunch that is starting a node may wait for itself, as after Ctrl-C


def _ended(process, code, before=""):
    """before: what was printed before; its last line may say why."""
    if code < 0:
        return f"{process} was ended by {signal.Signals(-code).name}"
    words = [line.strip() for line in before.splitlines() if line.strip()]
    return f"{process} ended with exit code {code}" + (f": {words[-1]}" if code and words else "")
