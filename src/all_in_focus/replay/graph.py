# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Runs evaluate.launch on a master of its own, with a time-out and an exit code.

roslaunch alone returns no exit code, and waits for ever where a program is missing.
"""
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from pathlib import Path

import rospkg
from roslib.packages import find_node
from tqdm import tqdm

from all_in_focus.files.output_folder import remove_leftovers
from all_in_focus.replay.run_status import BAD_INPUT, RunStatus

RUN_VARIABLE = "ALL_IN_FOCUS_RUN"  # in the environment of every process of a run
GRACE = 5.0  # s for an orderly shutdown
# Lines of roslaunch and of nodes that say why a run fails, the most specific first.
HINTS = (re.compile(r"cannot launch node of type \[.*"), re.compile(r"Failed to load nodelet.*"),
         re.compile(r"RLException: .*"), re.compile(r"Invalid .* tag.*"),
         re.compile(r"REQUIRED process \[(?!evaluation_player).* has died.*"),
         re.compile(r"\w+(?:Error|Exception): .*"))
HOPELESS = HINTS[:2]  # after these the run cannot succeed


class GraphError(RuntimeError):
    """The graph cannot be started; the message is one line."""


def child_environment(environment, port, log_folder):
    """Environment for roslaunch: the distribution's Python first, and a master of its own."""
    child = {name: value for name, value in environment.items()
             if name not in ("ROS_IP", "ROS_NAMESPACE", "PYTHONHOME", "ROSCONSOLE_FORMAT")}
    child.update(PATH=f"/usr/bin:/bin:{environment.get('PATH', '')}", ROS_MASTER_URI=f"http://localhost:{port}",
                 ROS_HOSTNAME="localhost", ROS_LOG_DIR=log_folder, PYTHONUNBUFFERED="1")
    child[RUN_VARIABLE] = uuid.uuid4().hex
    return child


def free_port():
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        return probe.getsockname()[1]


def check_install():
    """Path of evaluate.launch; GraphError that names what is missing."""
    remedy = "build the package, and source its build/.install/setup.bash"
    try:
        launch_file = Path(rospkg.RosPack().get_path("all_in_focus")) / "launch" / "evaluate.launch"
        for package, program in (("nodelet", "nodelet"), ("all_in_focus", "evaluation_player")):
            if not find_node(package, program):
                raise GraphError(f"program {program} of package {package} is missing: {remedy}")
    except rospkg.ResourceNotFound as error:
        raise GraphError(f"package {str(error).splitlines()[0]} is missing: {remedy}")
    if not launch_file.is_file():
        raise GraphError(f"{launch_file} is missing: {remedy}")
    library = "liball_in_focus_nodelets.so"
    prefixes = [prefix for prefix in os.environ.get("CMAKE_PREFIX_PATH", "").split(":") if prefix]
    if not any((Path(prefix) / "lib" / library).exists() for prefix in prefixes):
        raise GraphError(f"{library} is missing: {remedy}")
    return launch_file


class _Output(threading.Thread):
    """Reads what the graph prints and remembers the most specific line that says why it fails."""

    def __init__(self, stream, verbose):
        super().__init__(daemon=True)
        self._stream, self._verbose = stream, verbose
        self._found = {}
        self.start()

    def run(self):
        for line in self._stream:
            if self._verbose:
                sys.stderr.write(line)
            plain = re.sub(r"\x1b(?:\[[0-9;]*m|\][^\x07]*\x07)", "", line).strip()
            for pattern in HINTS:
                match = pattern.search(plain)
                if match:
                    self._found.setdefault(pattern, match.group())
                    break

    def hint(self, patterns=HINTS):
        return next((self._found[pattern] for pattern in patterns if pattern in self._found), None)


def run(arguments, output, timeout, verbose=False):
    """Runs evaluate.launch. arguments: its args by name; timeout: s without progress. Returns the final RunStatus."""
    launch_file = check_install()
    with tempfile.TemporaryDirectory(prefix="evaluate_bag.") as scratch:
        port = free_port()
        environment = child_environment(os.environ, port, str(Path(scratch) / "log"))
        status_file = Path(scratch) / "status.json"
        roslaunch = shutil.which("roslaunch", path=environment["PATH"])
        if roslaunch is None:
            raise GraphError("program roslaunch is missing: install ros-core")
        command = [roslaunch, "-p", str(port), launch_file, f"status:={status_file}"]
        command += [f"{pair[0]}:={pair[1]}" for pair in arguments.items()]
        process = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, text=True, errors="replace", start_new_session=True)
        printed = _Output(process.stdout, verbose)
        try:
            stopped_because = _watch(process, status_file, printed, timeout)
        finally:
            end_run(process, environment[RUN_VARIABLE])
        printed.join(1.0)
        status = final_status(RunStatus.read(status_file), stopped_because, printed.hint())
    if status.code != 0:
        remove_leftovers(output)  # of a killed player
    return status


def final_status(status, stopped_because, hint):
    """RunStatus of an ended run. status: the player's last, or None; stopped_because: of the watchdog, or None."""
    ended = status is not None and status.code is not None
    if ended and not stopped_because and not (hint and "from outside" in status.reason):
        return status
    reason = stopped_because or "the run ended before the bag was played"
    return RunStatus(BAD_INPUT, reason + (f": {hint}" if hint and hint not in reason else ""))


def _watch(process, status_file, printed, timeout):
    """Returns when the run is over: None, or the reason to stop it."""
    last, changed = None, time.monotonic()
    with tqdm(unit="message", disable=not sys.stderr.isatty()) as bar:
        while process.poll() is None:
            status = RunStatus.read(status_file)
            if status is not None and status.code is not None:
                return None  # not waiting for roslaunch to end
            if status is not None:
                bar.total = status.total
                bar.update(status.done - bar.n)
            stamp = status_file.stat().st_mtime_ns if status is not None else None
            if stamp != last:
                last, changed = stamp, time.monotonic()
            if printed.hint(HOPELESS):
                return printed.hint(HOPELESS)
            if time.monotonic() - changed > timeout:
                return f"no progress for {timeout:g} s"
            time.sleep(0.1)
    return None


def end_run(process, run_id):
    """Ends roslaunch and every process of the run; its children have process groups of their own."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(GRACE)
        except subprocess.TimeoutExpired:
            pass
    for sign in (signal.SIGTERM, signal.SIGKILL):
        rest = _processes_of(run_id)
        for pid in rest:
            try:
                os.kill(pid, sign)
            except ProcessLookupError:
                pass
        deadline = time.monotonic() + 3.0
        while rest and _processes_of(run_id) and time.monotonic() < deadline:
            process.poll()
            time.sleep(0.05)
    process.wait()


def _processes_of(run_id):
    """Processes that have the run's mark in their environment."""
    mark = f"{RUN_VARIABLE}={run_id}".encode()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if mark in (folder / "environ").read_bytes().split(b"\0"):
                found.append(int(folder.name))
        except OSError:
            pass  # gone, or of another user
    return found
