# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""tool_server.py LIBRARY: runs the main() of a program that is a library, each time in a new fork of this process.

The libraries of OpenCV are linked once, here: that takes ten times as long as most runs. A line on stdin is a run, as JSON:
{"command": [...], "cwd": ..., "environment": {...}, "output": [file for stdout, file for stderr]}. The answer is a line on
stdout: the exit code, as subprocess gives it.
"""
import ctypes
import json
import os
import sys


def run(main, command, cwd, environment, output):
    """In the fork: ends it."""
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    for number, path in enumerate([os.devnull, *output]):
        os.dup2(os.open(path, os.O_RDWR), number)
    values = (ctypes.c_char_p * (len(command) + 1))(*map(os.fsencode, command), None)
    os._exit(main(len(command), values))


def exit_code(status):
    return -os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)


if __name__ == "__main__":
    library = ctypes.CDLL(sys.argv[1])
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            run(library.main, **json.loads(line))
        print(exit_code(os.waitpid(child, 0)[1]), flush=True)
