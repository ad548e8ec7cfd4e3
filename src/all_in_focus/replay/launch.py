# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Launch files on a ROS master of their own, whose end is reported and leaves no process behind."""
import json
import os
import queue
import re
import signal
import socket
import subprocess
import sys
import threading
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import NamedTuple, Optional

GRACE = (5.0, 3.0)  # s between SIGINT, SIGTERM and SIGKILL to a process that does not end
SHUTDOWN = 3 * sum(GRACE) + 6.0  # s: the nodes together, then /rosout, then the master
LAUNCHER = Path(__file__).with_name("launcher.py")


class Death(NamedTuple):
    """A process that ended by itself."""
    process: str  # node name and a number
    code: Optional[int]  # exit code, or minus the number of a signal
    last_line: str = ""  # that the nodes printed before

    @property
    def node(self):
        return self.process.rpartition("-")[0] or self.process

    def __str__(self):
        if self.code is not None and self.code < 0:
            return f"{self.node} was ended by {signal.Signals(-self.code).name}"
        text = f"{self.node} ended with exit code {self.code}"
        return f"{text}: {self.last_line}" if self.code and self.last_line else text


def free_port():
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        return probe.getsockname()[1]


def child_environment(environment, port, log_folder):
    """Environment of the nodes: the distribution's Python first, and a master of its own."""
    child = {name: value for name, value in environment.items()
             if name not in ("ROS_IP", "ROS_NAMESPACE", "PYTHONHOME")}
    child.update(PATH=f"/usr/bin:/bin:{environment.get('PATH', '')}", ROS_MASTER_URI=f"http://localhost:{port}",
                 ROS_HOSTNAME="localhost", ROS_LOG_DIR=str(log_folder), PYTHONUNBUFFERED="1")
    return child


class Launch(AbstractContextManager):
    """Launches at once; close() must follow. The nodes end, too, when this process or launcher.py is killed."""

    def __init__(self, log_folder, files, arguments=(), verbose=False, grace=GRACE, port=None):
        """files: launch files, with arguments "name:=value"; verbose: repeats on stderr, or on the text file given, what
        roslaunch and the nodes print; grace: see GRACE; port: of a master on this computer that runs already."""
        port = port or free_port()
        environment = child_environment(os.environ, port, log_folder)
        self.master_uri = environment["ROS_MASTER_URI"]
        if not verbose:
            environment["ROSCONSOLE_FORMAT"] = "${message}"  # fit for Death.last_line
        self.deaths = []  # in their order, without those of the shutdown
        self._error = None  # why nothing could be launched
        self._running = {}  # pid by process
        self._echo = sys.stderr if verbose is True else verbose or None
        self._last_line = ""
        self._last_words = queue.SimpleQueue()  # of each process that died, in their order
        self._process = subprocess.Popen([sys.executable, str(LAUNCHER)], env=environment, text=True, errors="replace",
                                         stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                         start_new_session=True)
        self._events = threading.Thread(target=self._read_events, daemon=True)
        self._printed = threading.Thread(target=self._read_printed, daemon=True)
        self._events.start()
        self._printed.start()
        order = {"files": [str(file) for file in files], "arguments": list(arguments), "port": port, "grace": grace}
        with suppress(BrokenPipeError):
            print(json.dumps(order), file=self._process.stdin, flush=True)

    def _read_events(self):
        for line in self._process.stdout:
            event = json.loads(line)
            if "started" in event:
                self._running[event["started"]] = event["pid"]
            elif "died" in event:
                self._running.pop(event["died"], None)
                self.deaths.append(Death(event["died"], event["code"], self._last_words.get()))
            elif "error" in event:
                self._error = event["error"]
            elif self._echo:
                print(event["printed"], file=self._echo)

    def _read_printed(self):
        for line in self._process.stderr:
            line, died, _ = line.partition("\0")
            if self._echo:
                self._echo.write(line)
            line = re.sub(r"\x1b(?:\[[0-9;]*m|\][^\x07]*\x07)", "", line).strip()  # colours, titles of terminals
            self._last_line = line or self._last_line
            if died:
                self._last_words.put(self._last_line)

    def ended(self):
        """Whether nothing runs any more: nothing could be launched, or a required node or all nodes have ended."""
        if self._process.poll() is None:
            return False
        self._events.join()
        return True

    def reason(self):
        """Why it ended, one line; None if no process ended by itself."""
        failures = [death for death in self.deaths if death.code]  # first: roslaunch fails when a node dies early
        launcher = Death("the launcher", self._process.returncode, self._last_line) if self._process.poll() else None
        return next((str(reason) for reason in [*failures, self._error, launcher, *self.deaths] if reason), None)

    def close(self):
        """Ends the nodes, then the master."""
        with suppress(BrokenPipeError):
            self._process.stdin.close()
        try:
            self._process.wait(SHUTDOWN)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._events.join()
        if self._process.returncode != 0:  # it was killed, and its nodes go on
            for group in self._running.values():
                with suppress(ProcessLookupError):
                    os.killpg(group, signal.SIGKILL)
        self._printed.join(1.0)

    def __exit__(self, *_):
        self.close()
