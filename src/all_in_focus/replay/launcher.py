# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Process that runs roslaunch's library for a Launch (launch.py): it installs signal handlers, which a program of ours
must not lose, and needs the main thread.

stdin: one line of JSON, see launch(). Its end, also by the death of the caller, shuts everything down.
stdout: one JSON object a line: {"started": process, "pid": pid}, {"died": process, "code": exit code},
{"error": why nothing can be launched}, {"printed": line of roslaunch}. A process has a group of its own, whose id is pid.
stderr: what the nodes print. "\\0" follows the last words of a process that has died; then comes its event.
"""
import json
import os
import select
import sys
import threading
import time
from contextlib import suppress

import roslaunch.core
from roslaunch.config import load_config_default
from roslaunch.node_args import NodeParamsException, create_local_process_args
from roslaunch.parent import ROSLaunchParent
from roslaunch.pmon import ProcessListener, start_process_monitor
from roslaunch.rlutil import get_or_generate_uuid

POLL = 0.05  # s


class Events(ProcessListener):
    """Writes the events. Thread-safe."""

    def __init__(self, stream):
        self._stream, self._lock = stream, threading.Lock()

    def write(self, **event):
        with self._lock, suppress(BrokenPipeError):  # the caller has died, so stdin has ended, too
            print(json.dumps(event), file=self._stream, flush=True)

    def process_died(self, process_name, exit_code):
        with suppress(BrokenPipeError):
            os.write(2, b"\0\n")
        self.write(died=process_name, code=exit_code)


def watch(monitor, events, stop):
    """Reports every process that starts, a respawned one again, until stdin ends; then sets `stop`."""
    reported = set()
    while not (select.select([sys.stdin], [], [], POLL)[0] and not sys.stdin.readline()):
        for process in list(monitor.procs):
            started = process.name, process.pid
            if process.pid > 0 and started not in reported:
                reported.add(started)
                events.write(started=process.name, pid=process.pid)
    stop.set()


def launch(order, events):
    """order: files: launch files; arguments: of the files; port: of the master, which may run already; grace: s between
    SIGINT, SIGTERM and SIGKILL. Returns when a required process or all processes have died, or stdin has ended."""
    files = [(file, order["arguments"]) for file in order["files"]]
    run = get_or_generate_uuid(None, False)  # that of the master, if it runs already
    parent = ROSLaunchParent(run, files, port=order["port"], show_summary=False,
                             sigint_timeout=order["grace"][0], sigterm_timeout=order["grace"][1])
    parent.config = load_config_default(files, order["port"])
    for node in parent.config.nodes:  # the library only prints this, and goes on without the node
        try:
            create_local_process_args(node, node.machine)
        except NodeParamsException as error:
            raise roslaunch.core.RLException(f"node {node.name}: {error}")
    # The library adds the listeners that it is given after it has started the nodes: too late for an early death.
    parent.pm = start_process_monitor()
    parent.pm.add_process_listener(events)
    stop = threading.Event()
    threading.Thread(target=watch, args=(parent.pm, events, stop), daemon=True).start()
    try:
        parent.start()
        while not stop.is_set() and parent.runner.spin_once():
            time.sleep(POLL)
    finally:
        parent.shutdown()


def main():
    events = Events(os.fdopen(os.dup(1), "w", encoding="utf-8"))
    os.dup2(2, 1)  # nodes with output="screen" print there
    sys.stdout = sys.stderr = open(os.devnull, "w", encoding="utf-8")  # the library's words come by its handlers
    for clear, add in ((roslaunch.core.clear_printlog_handlers, roslaunch.core.add_printlog_handler),
                       (roslaunch.core.clear_printerrlog_handlers, roslaunch.core.add_printerrlog_handler)):
        clear()
        add(lambda text: events.write(printed=text))
    try:
        launch(json.loads(sys.stdin.readline()), events)
    except roslaunch.core.RLException as error:
        events.write(error=" ".join(str(error).split()))
    except Exception as error:  # of any kind: a wrong launch file makes the library raise many
        events.write(error=" ".join(f"{type(error).__name__}: {error}".split()))


if __name__ == "__main__":
    main()
