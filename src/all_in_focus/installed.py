# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The package's own programs: where they are, and running them."""
import os
import subprocess
from contextlib import suppress
from pathlib import Path

import rospkg

import all_in_focus

GRACE_S = 30.0  # for a program to end what it has started


def prefix():
    """Where the package is installed, or its devel space: the package is imported from lib/python3/dist-packages below it.

    Worker processes of a devel space import the package from its sources. For them this folder is of no use.
    """
    return Path(os.path.abspath(Path(all_in_focus.__file__).parent / "../../../.."))


def find(name):
    """Path of a program of this package; RuntimeError where there is none."""
    path = prefix() / "lib" / "all_in_focus" / name
    if path.is_file():
        return str(path)
    from roslib.packages import find_node  # the package is used from its sources: what the environment offers
    try:
        found = find_node("all_in_focus", name)
    except rospkg.ResourceNotFound:
        found = []
    if not found:
        raise RuntimeError(f"program {name} is missing: build the package, and source its build/.install/setup.bash")
    return found[0]


def run(command, timeout=None):
    """Run a program, and return what it has printed; one of this package finds the libraries of its own build.

    RuntimeError with its last line where it fails, or after `timeout` seconds.
    If an exception such as KeyboardInterrupt comes meanwhile, the program is ended by SIGTERM, so that evaluate_bag
    ends its nodes, and by SIGKILL if it ignores that.
    """
    program = Path(command[0])
    of_a_build = program.parent.name == "all_in_focus"  # maybe of another one, which has its own libraries
    libraries = os.pathsep.join([str(program.parent.parent if of_a_build else prefix() / "lib"),
                                 os.environ.get("LD_LIBRARY_PATH", "")])
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, errors="replace",
                          env=dict(os.environ, LD_LIBRARY_PATH=libraries)) as process:
        try:
            out, err = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"{program.name}: not done after {timeout:g} s, given up")
        finally:
            process.terminate()  # of no effect where it has ended
            with suppress(subprocess.TimeoutExpired):
                process.wait(GRACE_S)
            process.kill()
    if process.returncode:
        said = (err or out).strip().splitlines()
        raise RuntimeError(said[-1] if said else f"{program.name} ended with exit code {process.returncode}")
    return out
