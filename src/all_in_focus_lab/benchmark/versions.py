# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which versions of what are at work."""
import os
import platform
import re
import shutil
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import rospkg

import all_in_focus
from all_in_focus.files import stack
from all_in_focus.installed import find, prefix, run
from all_in_focus_lab import baselines, metrics
from all_in_focus_lab.benchmark.scenes import digest

LIBRARIES = ("numpy", "scipy", "skimage", "cv2", "distributed")


def code_digest():
    """Digest of the Python code that makes and measures images. Results may be compared where it is equal."""
    folders = [Path(module.__file__).parent for module in (metrics, baselines)]
    paths = [Path(stack.__file__), Path(__file__).with_name("methods.py")]
    paths += [path for folder in folders for path in folder.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    return digest(sorted(paths, key=lambda path: path.name))


def fusion_digest(program=""):
    """Digest of fuse_stack (of this package, or of another build) and of the library with the method."""
    path = Path(program or find("fuse_stack"))
    return digest([path, *sorted(path.parent.parent.glob("liball_in_focus_core.so"))])


def nodes_digest():
    """Digest of what makes images of bags: the nodes' libraries, and the code that starts them and plays bags to them."""
    folder = Path(all_in_focus.__file__).parent
    played = [path for module in ("replay", "bag") for path in sorted((folder / module).rglob("*.py"))]
    return digest([*played, Path(find("evaluate_bag")), *sorted((prefix() / "lib").glob("liball_in_focus_*.so"))])


def versions(program=""):
    """Name -> version of everything that results depend on; program: see fusion_digest()."""
    found = {"all_in_focus": _package_version(), "python": sys.version.split()[0]}
    for name in LIBRARIES:
        with suppress(ImportError):
            found[name] = import_module(name).__version__
    if shutil.which("enfuse"):
        found["enfuse"] = "unknown"
        with suppress(RuntimeError):
            found["enfuse"] = run(["enfuse", "--version"]).partition("\n")[0] or "unknown"
    found.update(code=code_digest(), fuse_stack=fusion_digest(program), nodes=nodes_digest(), machine=platform.node(),
                 system=platform.platform(), processor=f"{os.cpu_count()} x {_processor()}")
    return found


def _package_version():
    try:
        return rospkg.RosPack().get_manifest("all_in_focus").version
    except rospkg.ResourceNotFound:
        return "from sources"


def _processor():
    model = re.search(r"^model name\s*:(.*)", Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace"), re.M)
    return model[1].strip() if model else platform.machine()
