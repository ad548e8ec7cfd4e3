# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What all programs have in common: how signals end them, errors of one line, exit codes."""
import contextlib
import os
import re
import signal
import subprocess
import sys
import time

import pytest
from file_helpers import SCRIPTS, call, captured, listen_to_signals, run, script, start
from tool_helpers import TwoPlanes, succeeded

from all_in_focus import command_line

PROGRAMS = sorted(path.name for path in [*SCRIPTS.iterdir(), *(SCRIPTS / "lab").iterdir()]
                  if path.is_file() and path.read_bytes().startswith(b"#!/usr/bin/python3")
                  and "\nfrom all_in_focus" in path.read_text())
INTERRUPTED_IMPORT = """
import os, signal, sys

class Finder:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "cv2":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder)
"""
ENDING = """
import os, sys, time
from all_in_focus.command_line import run
from all_in_focus.files.output_folder import whole_folder

def main():
    with whole_folder(sys.argv[1], "test"):
        print("at work", flush=True)
        time.sleep(60)

run(main)
"""


def program(code, *arguments, **options):
    return start([sys.executable, "-c", code, *arguments], **options)


def test_every_program_begins_and_ends_alike():
    assert len(PROGRAMS) > 15
    for name in PROGRAMS:
        lines = script(name).read_text().splitlines()
        imports = [line for line in lines if line.startswith(("import ", "from "))]
        assert imports[0] == "import all_in_focus.early_exit  # noqa: F401", name
        assert lines[-2] == 'if __name__ == "__main__":' and lines[-1].startswith("    run("), name


@pytest.mark.parametrize("name", ["make_bag", "check_bag", "calibrate_rig", "evaluate_bag", "make_scene", "evaluate"])
def test_an_interrupt_during_the_imports_is_silent(tmp_path, name):
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTED_IMPORT)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = run([sys.executable, script(name), "--help"], env=dict(os.environ, PYTHONPATH=path), preexec_fn=listen_to_signals)
    assert done.returncode == -signal.SIGINT and done.stderr == done.stdout == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_a_program_with_their_code_and_nothing_left(tmp_path, number):
    with program(ENDING, tmp_path / "out") as process:
        assert process.stdout.readline() == "at work\n" and len(list(tmp_path.iterdir())) == 1
        process.send_signal(number)
        assert process.stderr.read() == "" and process.wait(20) == 128 + number
    assert not list(tmp_path.iterdir())


def test_an_interrupt_that_becomes_another_error_is_an_interrupt():
    code = """
import os, signal
from all_in_focus.command_line import run

def main():
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except KeyboardInterrupt:  # as numpy 1.24 does it in a comparison
        False.any()

run(main)
"""
    with program(code) as process:
        assert process.stderr.read() == "" and process.wait(60) == 128 + signal.SIGINT


@pytest.mark.parametrize("name, options", [
    ("make_scene", ["--scene", "planes", "--output", "{0}/s", "--frames", "900"]),
    ("make_bag", ["--depth", "{1}/depth.png", "--rig", "{1}/rig", "--stack", "{1}/many", "--output", "{0}/x.bag"])])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_program_at_work_leaves_nothing(tmp_path, name, options, number):
    planes = TwoPlanes(tmp_path / "planes")
    (planes.folder / "many").mkdir()
    for index in range(3000):
        os.link(str(planes.stack / "00.png"), str(planes.folder / "many" / f"{index:04d}.png"))
    (tmp_path / "out").mkdir()
    command = [word.format(tmp_path / "out", planes.folder) for word in options]
    with start([sys.executable, script(name), *command]) as process:
        while not list((tmp_path / "out").iterdir()) and process.poll() is None:
            time.sleep(0.01)
        process.send_signal(number)
        assert process.stderr.read() == "" and process.wait(60) == 128 + number
    assert not list((tmp_path / "out").iterdir())


def test_a_node_whose_end_hangs_ends_in_any_case():
    code = """
import os, signal, threading
from all_in_focus import command_line
command_line.LONGEST_END = 0.1
def main():
    command_line.end_in_any_case()
    lock = threading.Lock()
    lock.acquire()
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    finally:
        lock.acquire()
command_line.run(main)
"""
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 128 + signal.SIGTERM


def test_a_bar_that_a_signal_interrupts_is_silent():
    code = """
import io, os, signal
from all_in_focus.command_line import run
from all_in_focus.progress import Progress

class Terminal(io.StringIO):
    def isatty(self):  # asked by the bar while it is made
        os.kill(os.getpid(), signal.SIGTERM)

run(lambda: Progress(file=Terminal()))
"""
    with program(code) as process:
        assert process.stderr.read() == "" and process.wait(60) == 128 + signal.SIGTERM


def test_an_interrupt_that_the_parent_ignores_stays_ignored():
    code = "import all_in_focus.early_exit, os, signal\nfrom all_in_focus.command_line import run\n" \
           "run(lambda: os.kill(os.getpid(), signal.SIGINT))"
    with program(code, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)) as process:
        assert process.wait(60) == 0


def test_a_node_that_waits_for_a_master_can_be_interrupted():
    environment = dict(os.environ, ROS_MASTER_URI="http://localhost:9", PYTHONUNBUFFERED="1")
    with start([sys.executable, SCRIPTS / "rig_publisher"], env=environment) as process:
        assert "master may not be running yet" in process.stdout.readline()
        while process.poll() is None:  # rospy may lose the first one, while it installs its own handlers
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(20)
        assert process.stderr.read() == "" and process.returncode == 128 + signal.SIGINT


def test_a_node_with_parameters_says_that_there_is_no_master():
    environment = dict(os.environ, ROS_MASTER_URI="http://localhost:9")
    ended = run([sys.executable, SCRIPTS / "rig_publisher", "_rig:=rig"], env=environment)
    assert ended.returncode == 2 and ended.stderr == (
        "rig_publisher: the ROS master at http://localhost:9 does not answer: start roscore, or compare ROS_MASTER_URI\n")


@pytest.mark.parametrize("error, said", [
    (ValueError("two\nlines"), "two lines"),
    (OSError(28, "No space left on device"), "[Errno 28] No space left on device"),
    (FileNotFoundError(2, "No such file", "x"), "x: No such file"), (MemoryError(), "MemoryError")])
def test_errors_are_one_line(monkeypatch, error, said):
    def main():
        raise error

    monkeypatch.setattr(sys, "argv", ["/x/name"])
    with captured() as printed, pytest.raises(SystemExit) as stop:
        command_line.run(main)
    assert (stop.value.code, printed) == (2, ["", f"name: {said}\n"])


def test_mistakes_of_ours_are_not_hidden():
    code = "from all_in_focus.command_line import run\ndef main():\n    raise KeyError('a mistake of ours')\nrun(main)"
    with program(code) as process:
        _, err = process.communicate(timeout=300)
    assert process.returncode == 1 and "Traceback" in err and "a mistake of ours" in err


def test_a_reader_that_has_seen_enough():
    code = "from all_in_focus.command_line import run\nrun(lambda: print('x' * 10000000))"
    with program(code) as process:
        process.stdout.read(10)
        process.stdout.close()
        assert process.stderr.read() == "" and process.wait(60) == 128 + signal.SIGPIPE


def test_help_of_every_program():
    for name in ("check_bag", "bag_to_stack", "make_scene"):
        assert succeeded(call(name, "--help")).stdout.startswith("usage: ")


@pytest.mark.parametrize("name", ["focus_bracket_camera", "image_folder_camera", "replay_bag", "capture", "depth_file_camera",
                                  "rig_publisher"])
def test_help_of_a_node_lists_its_parameters(name):
    shown = succeeded(call(name, "--help")).stdout
    listed = set(re.findall(r"^  ~(\w+) +\w", shown, re.M))
    sources = (SCRIPTS / name, *(SCRIPTS.parent / "src" / "all_in_focus" / "camera").glob("*.py"))
    used = set(re.findall(r"settings\.(\w+)", (SCRIPTS / name).read_text()))
    assert listed and used <= listed
    assert all(any(f'"{parameter}": Parameter(' in path.read_text() for path in sources) for parameter in listed)
