# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""tool_server.py [LIBRARY]: runs programs, each in a new fork of this process: the main() of LIBRARY, or programs in Python.

What takes longer than most runs is done once, here: to link the libraries of OpenCV, and to import modules. A line on stdin
starts a program, as JSON: {"command": [...], "cwd": ..., "environment": {...}, "output": [file for stdout, file for stderr]};
the answer is a line on stdout, the process id. Such a number as a line asks for the exit code, as subprocess gives it; the
answer is null until it has ended, but waits for the end where the number is negative.
"""
import ctypes
import importlib
import json
import os
import runpy
import sys
from pathlib import Path

LIBRARY = ctypes.CDLL(sys.argv[1]) if sys.argv[1:] else None
# Of the package nothing but messages, and not rospy: it reads the command line when it is imported.
MODULES = ("cv2", "PIL.Image", "roslib", "rosgraph.xmlrpc", "sensor_msgs.msg", "std_srvs.srv", "diagnostic_msgs.msg",
           "all_in_focus.msg")


def run(command, files):
    """In the fork."""
    for number, file in enumerate([os.open(os.devnull, os.O_RDONLY), *files]):
        os.dup2(file, number)
    if LIBRARY:
        os._exit(LIBRARY.main(len(command), (ctypes.c_char_p * (len(command) + 1))(*map(os.fsencode, command), None)))
    sys.argv, sys.path[0] = command, str(Path(command[0]).parent)
    sys.stdout, sys.stderr = (open(number, "w", 1, errors=errors) for number, errors in ((1, "strict"), (2, "backslashreplace")))
    runpy.run_path(command[0], run_name="__main__")


def exit_code(pid):
    ended, status = os.waitpid(abs(pid), 0 if pid < 0 else os.WNOHANG)
    if not ended:
        return None
    return -os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)


def serve():
    """Returns in a fork, what it is to run; at the end of stdin None."""
    for line in sys.stdin:
        request = json.loads(line)
        if isinstance(request, int):
            print(json.dumps(exit_code(request)), flush=True)
            continue
        files = [os.open(path, os.O_WRONLY) for path in request["output"]]
        pid = os.fork()
        if pid == 0:
            os.chdir(request["cwd"])
            os.environ.clear()
            os.environ.update(request["environment"])
            return request["command"], files
        for file in files:
            os.close(file)
        print(pid, flush=True)
    return None


if __name__ == "__main__":
    for name in () if LIBRARY else MODULES:
        importlib.import_module(name)
    wanted = serve()
    if wanted:
        run(*wanted)
