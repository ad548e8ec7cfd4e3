# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A ROS master of one's own, on a free port, and the programs that run under it."""
import os
import shutil
import socket
import subprocess
import time

import roslib.packages
import rosgraph

QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
PATIENCE_S = 30


class Ros:
    """with Ros() as ros: a master runs; what ros.start() starts ends with it."""

    def __enter__(self):
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
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
        if shutil.which(command[0]) is None:
            raise RuntimeError(f"{command[0]} is not installed, or setup.bash is not sourced")
        process = subprocess.Popen(command, **QUIET)
        self.started.append(process)
        return process

    def stop(self, process):
        process.terminate()
        try:
            process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self.started.remove(process)

    def __exit__(self, *_):
        for process in reversed(list(self.started)):
            self.stop(process)


def program(package, name):
    """Path of a package's executable. RuntimeError where there is none."""
    found = roslib.packages.find_node(package, name)
    if not found:
        raise RuntimeError(f"{package}/{name} is not installed, or setup.bash is not sourced")
    return found[0]


def cpu_seconds(pid):
    """User and system time of a process so far, all its threads together."""
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
