# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The package's own programs, and which versions of what are at work."""
import hashlib
import os
import platform
import shutil
import subprocess
import sys
from importlib import import_module

import rospkg

import all_in_focus
from all_in_focus import baselines, metrics
from all_in_focus.metrics import truth as quality
from all_in_focus.files import stack

LIBRARIES = ("numpy", "scipy", "skimage", "cv2", "distributed")


def prefix():
    """Where the package is installed, or its devel space: the package is imported from lib/python3/dist-packages."""
    return os.path.abspath(os.path.join(os.path.dirname(all_in_focus.__file__), *[os.pardir] * 4))


def find(name):
    """Path of a program of this package; RuntimeError where there is none."""
    path = os.path.join(prefix(), "lib", "all_in_focus", name)
    if os.path.isfile(path):
        return path
    from roslib.packages import find_node  # the package is used from its sources: what the environment offers
    try:
        found = find_node("all_in_focus", name)
    except rospkg.ResourceNotFound:
        found = []
    if not found:
        raise RuntimeError("program %s is missing: build the package, and source its build/.install/setup.bash" % name)
    return found[0]


def run(command, timeout=None):
    """Run a program of this package; RuntimeError with its last line where it fails."""
    libraries = os.pathsep.join([os.path.join(prefix(), "lib"), os.environ.get("LD_LIBRARY_PATH", "")])
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True,
                            errors="replace", timeout=timeout, env=dict(os.environ, LD_LIBRARY_PATH=libraries))
    if result.returncode:
        said = (result.stderr or result.stdout).strip().splitlines()
        raise RuntimeError(said[-1] if said else "%s: exit code %d" % (os.path.basename(command[0]), result.returncode))


def code_digest():
    """Of the Python code that makes and measures images: the same wherever results may be put side by side."""
    files = [metrics.__file__, baselines.__file__]
    paths = [quality.__file__, stack.__file__, os.path.join(os.path.dirname(os.path.abspath(__file__)), "methods.py")]
    for folder in (os.path.dirname(file) for file in files):
        paths += [os.path.join(above, name) for above, _, names in os.walk(folder) for name in names
                  if not name.endswith(".pyc")]
    return _digest(sorted(paths, key=os.path.basename))


def fusion_digest():
    """Of fuse_stack and the library with the method."""
    library = os.path.join(prefix(), "lib", "liball_in_focus_core.so")
    return _digest([find("fuse_stack")] + [library] * os.path.exists(library))


def _digest(paths):
    total = hashlib.sha256()
    for path in paths:
        with open(path, "rb") as file:
            total.update(file.read())
    return total.hexdigest()[:16]


def versions():
    """Name -> version, of what results depend on."""
    found = {"all_in_focus": _package_version(), "python": sys.version.split()[0]}
    for name in LIBRARIES:
        try:
            found[name] = import_module(name).__version__
        except ImportError:
            pass
    if shutil.which("enfuse"):
        found["enfuse"] = _first_line(["enfuse", "--version"])
    found.update(code=code_digest(), fuse_stack=fusion_digest(), machine=platform.node(), system=platform.platform(),
                 processor="%d x %s" % (os.cpu_count(), _processor()))
    return found


def _package_version():
    try:
        return rospkg.RosPack().get_manifest("all_in_focus").version
    except rospkg.ResourceNotFound:
        return "from sources"


def _first_line(command):
    said = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True,
                          errors="replace").stdout.strip().splitlines()
    return said[0] if said else "unknown"


def _processor():
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.machine()
