# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small stacks on disk, and the command line tools as people call them."""
import atexit
import ctypes
import fcntl
import json
import os
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

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


def write_pages(path, frames, **options):
    """A TIFF with a page for each frame."""
    pages = [Image.fromarray(np.ascontiguousarray(frame[..., ::-1] if frame.ndim == 3 else frame)) for frame in frames]
    pages[0].save(path, save_all=True, append_images=pages[1:], **options)
    return path


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


def script(name):
    """Path of a program: one of the runtime, of the laboratory, or an absolute path."""
    laboratory = SCRIPTS / "lab" / name
    return laboratory if laboratory.exists() else SCRIPTS / name


def listen_to_signals():
    """For preexec_fn: signals end the program also where the tests run in the background or under nohup, which ignore some."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def start(command, **options):
    """A program at work."""
    return subprocess.Popen([str(part) for part in command], **{**AS_TEXT, "preexec_fn": listen_to_signals, **options})


def run(command, **options):
    """A program that has ended, with what it has printed."""
    return subprocess.run([str(part) for part in command], **{**AS_TEXT, "timeout": 300, **options})


def run_script(name, *arguments, **options):
    return run([sys.executable, script(name), *arguments], **{"env": environment(), **options})


class ToolServer:
    """tool_server.py at work."""

    def __init__(self, *arguments):
        self._lock = threading.Lock()
        self._process = subprocess.Popen([sys.executable, str(Path(__file__).with_name("tool_server.py")), *map(str, arguments)],
                                         bufsize=1, universal_newlines=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                         preexec_fn=listen_to_signals)
        atexit.register(self._process.wait)
        atexit.register(self._process.terminate)  # first

    def ask(self, request):
        with self._lock:
            print(json.dumps(request), file=self._process.stdin)
            return json.loads(self._process.stdout.readline())

    def start(self, command, environment, *output):
        """The process id."""
        return self.ask({"command": [str(part) for part in command], "cwd": os.getcwd(), "environment": environment,
                         "output": output})

    def run(self, command, environment):
        """Like run()."""
        with tempfile.NamedTemporaryFile("r", errors="replace") as out, tempfile.NamedTemporaryFile("r", errors="replace") as err:
            code = self.ask(-self.start(command, environment, out.name, err.name))
            return subprocess.CompletedProcess(command, code, out.read(), err.read())


@lru_cache(maxsize=None)
def python_server():
    return ToolServer()


class Fork:
    """Like start() of a program in Python, with stderr in stdout, but in a fork of a process that has imported most modules:
    that takes ten times as long as a node that only says something."""

    def __init__(self, command, environment):
        self.args, self.returncode, self._lock = command, None, threading.Lock()
        reading, writing = os.pipe()
        self.stdout = open(reading, encoding="utf-8", errors="replace")
        self.pid = python_server().start(command, environment, *2 * (f"/proc/{os.getpid()}/fd/{writing}",))
        os.close(writing)

    def poll(self):
        with self._lock:
            if self.returncode is None:
                self.returncode = python_server().ask(self.pid)
            return self.returncode

    def wait(self, timeout):
        if wait_until(lambda: self.poll() is not None, timeout):
            return self.returncode
        raise subprocess.TimeoutExpired(self.args, timeout)

    def send_signal(self, number):
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)


def fork_script(name, *arguments):
    """Like run_script(), but in a fork as well."""
    return python_server().run([script(name), *arguments], environment())


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


def wait_for(process, condition, timeout=300.0):
    """The first true value of condition() while a program works. If none comes, the test fails with what the program says."""
    found = []
    wait_until(lambda: found.append(condition()) or found[-1] or process.poll() is not None, timeout)
    if not found[-1]:
        process.kill()
        pytest.fail(f"{' '.join(process.args)} said {process.communicate()}, exit code {process.returncode}")
    return found[-1]


@contextmanager
def captured():
    """A list that holds stdout and stderr afterwards: what is printed meanwhile in this process, by C and C++, too."""
    said = []
    with ExitStack() as at_the_end:
        files = [at_the_end.enter_context(tempfile.TemporaryFile("w+", 1, encoding="utf-8", errors="replace"))
                 for _ in range(2)]
        sys.stdout.flush()
        loud = [os.dup(number) for number in (1, 2)]
        try:
            for number, file in zip((1, 2), files):
                os.dup2(file.fileno(), number)
            with redirect_stdout(files[0]), redirect_stderr(files[1]):
                yield said
        finally:
            ctypes.CDLL(None).fflush(None)
            for number, old in zip((1, 2), loud):
                os.dup2(old, number)
                os.close(old)
        for file in files:
            file.seek(0)
            said.append(file.read())


class VirtualTime:
    """Stands in for the module `time` in some modules: who sleeps only moves the clock."""

    def __init__(self, monkeypatch, *modules):
        self._now = 1000.0
        for module in modules:
            monkeypatch.setattr(module, "time", self)

    def monotonic(self):
        return self._now

    def sleep(self, seconds):
        self._now += seconds


def call(name, *arguments):
    """Like run_script(), but in this process: to start Python and to import OpenCV takes longer than most tests. Not for
    what a process has of its own: signals, environment, limits, that it has one thread, and that it becomes a node of ROS."""
    path = script(name)
    old_arguments, old_handler = sys.argv, signal.getsignal(signal.SIGINT)
    sys.argv = [str(path), *map(str, arguments)]
    try:
        with captured() as said, pytest.raises(SystemExit) as stop:
            exec(compile(path.read_text(encoding="utf-8"), path, "exec"), {"__name__": "__main__", "__file__": str(path)})
    finally:
        sys.argv = old_arguments
        signal.signal(signal.SIGINT, old_handler)  # early_exit.py has set its own
    return subprocess.CompletedProcess([str(path), *arguments], stop.value.code or 0, *said)


# --- made once for all tests ------------------------------------------------------------------------------------------

def cache_folder():
    """ALL_IN_FOCUS_TEST_CACHE, which tests that run side by side share; without it a folder until this process ends."""
    name = "ALL_IN_FOCUS_TEST_CACHE"
    if name not in os.environ:
        os.environ[name] = tempfile.mkdtemp(prefix="all_in_focus_test_cache.")
        atexit.register(shutil.rmtree, os.environ[name], ignore_errors=True)
    return Path(os.environ[name])


def made_once(make, *key):
    """The path that make(path) has made, the same for the same key; whoever needs it first makes it. To be read only."""
    name = re.sub(r"[\s/]+", "_", " ".join(map(str, key)))
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    path, working = folder / name, folder / f"new_{name}"
    with open(str(folder / f"lock_{name}"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            shutil.rmtree(str(working), ignore_errors=True)
            make(working)
            working.rename(path)
    return path
