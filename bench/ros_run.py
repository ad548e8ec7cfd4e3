# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A ROS master of one's own, on a free port, and the programs that run under it."""
import os
import subprocess
import time

import psutil
import rosgraph

from all_in_focus.replay.launch import free_port

PATIENCE_S = 30


class Ros:
    """with Ros() as ros: a master runs; what ros.start() starts ends with it."""

    def __enter__(self):
        port = free_port()
        os.environ.update(ROS_MASTER_URI=f"http://localhost:{port}", ROS_HOSTNAME="localhost")
        self.started = []
        self.start(["roscore", "-p", str(port)])
        deadline = time.monotonic() + PATIENCE_S
        while not rosgraph.is_master_online():
            if time.monotonic() > deadline:
                self.__exit__()
                raise RuntimeError("roscore does not come up")
            time.sleep(0.1)
        return self

    def start(self, command):
        self.started.append(psutil.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        return self.started[-1]

    def __exit__(self, *_):
        for process in reversed(self.started):
            process.terminate()
            for deaf in psutil.wait_procs([process], PATIENCE_S)[1]:
                deaf.kill()


def cpu_seconds(pid):
    """User and system time of a process so far, all its threads together."""
    times = psutil.Process(pid).cpu_times()
    return times.user + times.system
