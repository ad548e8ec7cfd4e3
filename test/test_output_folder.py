# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Output folders are complete or not there, and nobody else's files are touched."""
import fcntl
import os
import signal
import subprocess
import sys

import pytest
from tool_helpers import snapshot, unchanged

from all_in_focus.files import output_folder
from all_in_focus.files.output_folder import MARK, OutputFolder, read_mark, whole_folder

PROGRAM = "a_program"


def write(path, text="new", program=PROGRAM, **options):
    with whole_folder(path, program, **options) as working:
        (working / "sub").mkdir()
        (working / "sub" / "a.txt").write_text(text)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def refused(complaint, path, **options):
    with unchanged(path.parent), pytest.raises(OSError, match=complaint) as error:
        write(path, **options)
    assert str(error.value.filename).startswith(str(path)) and error.value.filename2 is None


def test_a_folder_appears_whole_with_a_mark(tmp_path):
    out = tmp_path / "out"
    with whole_folder(out, PROGRAM) as working:
        (working / "a.txt").write_text("1")
        assert not out.exists()
    mark = read_mark(out)
    assert mark["program"] == PROGRAM and mark["files"] == ["a.txt"]
    assert names(out) == [MARK, "a.txt"] and names(tmp_path) == ["out"]


def test_a_later_run_replaces_all_of_an_earlier_one(tmp_path):
    out = tmp_path / "out"
    with whole_folder(out, PROGRAM) as working:
        (working / "old.txt").write_text("1")
    os.chmod(out, 0o750)
    write(out)
    assert names(out) == [MARK, "sub"] and names(tmp_path) == ["out"] and out.stat().st_mode & 0o777 == 0o750


def test_a_write_protected_folder_is_refused_before_the_work(tmp_path, monkeypatch):
    out = tmp_path / "out"
    out.mkdir()
    (out / "of_the_user").write_text("")
    monkeypatch.setattr(os, "access", lambda path, mode: path != out)  # root may write everywhere
    with unchanged(tmp_path), pytest.raises(PermissionError, match="is write-protected"):
        OutputFolder(out, PROGRAM, may_keep=lambda name: True)


def test_after_an_error_everything_is_as_before(tmp_path):
    out = tmp_path / "out"
    for _ in range(2):
        with unchanged(tmp_path), pytest.raises(ZeroDivisionError), whole_folder(out, PROGRAM) as working:
            (working / "half").write_text("")
            1 / 0
        write(out)


@pytest.mark.parametrize("marks", [0, 1])
def test_a_signal_while_a_mark_is_written_leaves_nothing(tmp_path, monkeypatch, marks):
    write_text, written = output_folder.Path.write_text, []

    def interrupted(path, *args, **kwargs):
        written.append(path)
        if len(written) <= marks:
            return write_text(path, *args, **kwargs)
        path.write_bytes(b"")
        raise KeyboardInterrupt

    monkeypatch.setattr(output_folder.Path, "write_text", interrupted)
    with pytest.raises(KeyboardInterrupt), whole_folder(tmp_path / "out", PROGRAM) as working:
        (working / "result").touch()
    assert len(written) == marks + 1 and names(tmp_path) == []


@pytest.mark.parametrize("name", ["mine.txt", "sub/mine.txt", "sub"])
def test_what_others_have_written_is_refused(tmp_path, name):
    out = tmp_path / "out"
    if name != "sub":
        write(out)
    (out / name).parent.mkdir(exist_ok=True)
    (out / name).write_text("mine")
    refused("was not written by a_program", out)


def test_a_folder_of_another_program_is_refused(tmp_path):
    write(tmp_path / "out", program="other")
    refused("was written by other: choose another folder", tmp_path / "out", may_keep=lambda name: True)


def test_a_mark_that_cannot_be_read_owns_nothing(tmp_path):
    write(tmp_path / "out")
    (tmp_path / "out" / MARK).write_text("{}")
    refused("was not written by a_program", tmp_path / "out")


def test_what_may_stay_stays(tmp_path):
    out = tmp_path / "out"
    (out / "mine").mkdir(parents=True)
    (out / "mine" / "notes").write_text("x")
    (out / "link").symlink_to("mine")
    for text in ("1", "2"):
        write(out, text, may_keep=lambda name: name in ("mine", "link"))
    assert names(out) == [MARK, "link", "mine", "sub"] and (out / "mine" / "notes").read_text() == "x"
    assert (out / "link").is_symlink() and (out / "sub" / "a.txt").read_text() == "2" and names(tmp_path) == ["out"]
    (out / "sub" / "mine.txt").write_text("y")
    refused("sub/mine.txt", out, may_keep=lambda name: True)


def test_what_may_stay_does_not_give_way_to_new_entries(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "sub").write_text("mine")
    refused("was not written by", tmp_path / "out", may_keep=lambda name: True)


def test_results_made_by_advice_are_removed(tmp_path):
    out = tmp_path / "out"
    write(out, results=["fused.png"])
    (out / "fused.png").write_text("")
    (out / "sub" / "fused.png").write_text("")
    write(out, results=["fused.png"])
    assert snapshot(out).keys() == {MARK, "sub", "sub/a.txt"}


def test_symlinks_are_refused_not_followed(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "out").symlink_to("there")
    refused("is a symbolic link", tmp_path / "out")
    (tmp_path / "out").unlink()
    (tmp_path / "there" / "a.txt").write_text("mine")
    write(tmp_path / "out")
    os.rename(tmp_path / "out" / "sub", tmp_path / "sub")
    (tmp_path / "out" / "sub").symlink_to(tmp_path / "there")
    refused("sub: ?.*|symbolic link", tmp_path / "out")
    assert (tmp_path / "there" / "a.txt").read_text() == "mine"


def test_a_file_or_a_missing_parent(tmp_path):
    (tmp_path / "file").write_text("")
    refused("is no folder", tmp_path / "file")
    with pytest.raises(FileNotFoundError) as error:
        write(tmp_path / "none" / "out")
    assert error.value.filename == str(tmp_path / "none" / "out") and names(tmp_path) == ["file"]
    write(tmp_path / "none" / "out", parents=True)
    assert names(tmp_path / "none") == ["out"]


def test_the_current_folder_is_refused(tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path / "out")
    refused("is the current folder", tmp_path / "out")


def test_two_runs_do_not_meet(tmp_path):
    out = tmp_path / "out"
    first = OutputFolder(out, PROGRAM)
    with pytest.raises(BlockingIOError, match="another run is writing there"):
        OutputFolder(out, PROGRAM)
    (first.working / "a.txt").write_text("")
    first.commit()
    first.discard()
    write(out)
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("module, function", [(os, "open"), (fcntl, "flock"), (os.path, "samestat")])
def test_a_signal_while_locking_leaves_nothing(tmp_path, monkeypatch, module, function):
    call = getattr(module, function)

    def interrupted(*arguments):
        monkeypatch.undo()
        call(*arguments)
        raise SystemExit(143)

    monkeypatch.setattr(module, function, interrupted)
    with pytest.raises(SystemExit):
        OutputFolder(tmp_path / "out", PROGRAM)
    assert names(tmp_path) == []
    write(tmp_path / "out")
    assert names(tmp_path) == ["out"]


KILLED = """
import os, signal, sys
from all_in_focus.files.output_folder import OutputFolder
folder = OutputFolder(sys.argv[1], "a_program", may_keep=lambda name: True)
(folder.working / "half.txt").write_text("")
renames, left = type(folder.working).rename, int(sys.argv[2])
def rename(one, other):
    global left
    left -= 1
    return renames(one, other) if left >= 0 else os.kill(os.getpid(), signal.SIGKILL)
type(folder.working).rename = rename
folder.commit()
"""


@pytest.mark.parametrize("renames, files", [(0, ["sub/a.txt"]), (1, ["sub/a.txt"]), (2, ["half.txt"])])
def test_what_a_killed_run_leaves_is_cleaned_up_by_the_next(tmp_path, renames, files):
    """Killed before the former output went aside, before the new one came, before the user's files followed."""
    out = tmp_path / "out"
    write(out)
    (out / "mine").write_text("x")
    done = subprocess.run([sys.executable, "-c", KILLED, str(out), str(renames)], check=False)
    assert done.returncode == -signal.SIGKILL and len(names(tmp_path)) == 2
    (tmp_path / ".out.0123456789ab.incomplete").mkdir()  # of somebody else
    (tmp_path / ".out.0123456789ab.incomplete" / "mine2").write_text("y")
    OutputFolder(out, PROGRAM, may_keep=lambda name: True).discard()
    assert (out / "mine").read_text() == "x" and read_mark(out)["files"] == files
    write(out, may_keep=lambda name: True)
    kept = sorted(path.read_text() for path in tmp_path.rglob("mine*"))
    assert kept == ["x", "y"] and names(tmp_path) == [".out.0123456789ab.incomplete", "out"]


@pytest.mark.parametrize("name", [".out.incomplete", ".out.former"])
def test_folders_of_others_beside_the_output_are_refused(tmp_path, name):
    write(tmp_path / "out")
    (tmp_path / name).mkdir()
    (tmp_path / name / "mine").write_text("x")
    with unchanged(tmp_path), pytest.raises(OSError, match="was not written by a run|not empty"):
        write(tmp_path / "out")
