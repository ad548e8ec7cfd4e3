# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small stacks on disk, and the command line tools as people call them."""
import io
import os
import resource
import signal
import struct
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import cv2
import numpy as np
import pytest

SCRIPTS = Path(__file__).resolve().parent.parent / "scripts"
SIZE = (48, 32)  # width, height
AS_TEXT = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "universal_newlines": True, "errors": "replace"}
# A BMP of 2^21 x 2^21 pixels, as far as its header goes: OpenCV does not even try.
ENDLESS_PICTURE = b"BM" + struct.pack("<IHHI IiiHHIIiiII", 54, 0, 0, 54, 40, 1 << 21, 1 << 21, 1, 24, *(0,) * 6)


def pictures(count, size=SIZE, seed=0):
    random = np.random.default_rng(seed)
    return [random.integers(0, 256, (size[1], size[0], 3), np.uint8) for _ in range(count)]


def write_stack(folder, names, frames=None):
    folder.mkdir(exist_ok=True)
    for name, frame in zip(names, frames or pictures(len(names))):
        cv2.imwrite(str(folder / name), frame)
    return folder


def write_video(path, frames):
    frames = list(frames)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, frames[0].shape[1::-1])
    for frame in frames:
        video.write(frame)
    video.release()
    return path


def cut(path, share=0.6):
    """Leaves the first part of a file."""
    data = Path(path).read_bytes()
    Path(path).write_bytes(data[:int(len(data) * share)])


def hide_cut(avi):
    """Writes a header that does not give away that a video was cut."""
    data = bytearray(avi.read_bytes())
    data[4:8] = (len(data) - 8).to_bytes(4, "little")
    avi.write_bytes(data)


def focus_file(tmp_path, text):
    path = tmp_path / "focus.yaml"
    path.write_text(text)
    return path


def environment(**more):
    """The distribution's Python first."""
    return dict(os.environ, PATH=os.pathsep.join(["/usr/bin", "/bin", os.environ.get("PATH", "")]), **more)


def start(command, **options):
    """A program at work."""
    return subprocess.Popen([str(part) for part in command], **{**AS_TEXT, **options})


def run(command, **options):
    """A program that has ended, with what it has printed."""
    return subprocess.run([str(part) for part in command], **{**AS_TEXT, "timeout": 300, **options})


def run_script(name, *arguments, **options):
    return run([sys.executable, SCRIPTS / name, *arguments], **{"env": environment(), **options})


def file_limit(kb):
    """For preexec_fn, with restore_signals=False: a limit on the size of each file stands in for a full disk."""
    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (kb * 1024, kb * 1024))
    return limit


def wait_until(condition, timeout=60.0):
    """The first true value of condition(), or its last one."""
    end = time.monotonic() + timeout
    while True:
        value = condition()
        if value or time.monotonic() > end:
            return value
        time.sleep(0.02)


def call(script, *arguments):
    """(exit code, stdout, stderr) of a script of the repository, run in this process: starting Python takes longer."""
    path = SCRIPTS / script
    out, err = io.StringIO(), io.StringIO()
    old_arguments, old_handler = sys.argv, signal.getsignal(signal.SIGINT)
    sys.argv = [str(path), *map(str, arguments)]
    try:
        with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as stop:
            exec(compile(path.read_text(encoding="utf-8"), path, "exec"), {"__name__": "__main__"})
    finally:
        sys.argv = old_arguments
        signal.signal(signal.SIGINT, old_handler)  # early_exit.py has set its own
    return stop.value.code or 0, out.getvalue(), err.getvalue()
