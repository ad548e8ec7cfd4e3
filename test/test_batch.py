# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""fuse_stack with several stacks: what belongs together, where results go, failures, and a second run."""
import os
import shutil
import time

import cv2
import numpy as np
import pytest
from PIL import Image

from file_helpers import cut, write_video
from tool_helpers import SIZE, TwoPlanes, expect_refusal, fuse_stack, read, read_report, succeeded, texture, unchanged, write

PHOTO, TIME, FRACTION = 0x8769, 0x9003, 0x9291


@pytest.fixture
def planes(tmp_path):
    return TwoPlanes(tmp_path / "planes")


def bracket(folder, seed=0, first=0, ending="png"):
    """Three frames of a scene of its own; the middle one is sharp."""
    folder.mkdir(parents=True, exist_ok=True)
    sharp = texture(seed=seed)
    for index in range(3):
        blurred = sharp if index == 1 else cv2.GaussianBlur(sharp, (0, 0), 2)
        write(folder / f"IMG_{first + index:04d}.{ending}", blurred)
    return sharp


def table(done):
    """Rows of the table, name -> what follows; and the count."""
    lines = done.stdout.splitlines()
    assert lines[0].split() == ["stack", "frames", "result"], done.stdout
    return {line.split()[0]: " ".join(line.split()[1:]) for line in lines[1:-1]}, lines[-1]


def test_a_folder_of_folders(tmp_path):
    sharp = {name: bracket(tmp_path / "shoot" / name, seed) for seed, name in enumerate(("leaf 2", "leaf 10", "ant"))}
    (tmp_path / "shoot" / "notes").mkdir()
    (tmp_path / "shoot" / "notes" / "read.txt").write_text("no pictures here")
    out = tmp_path / "shoot" / "out"
    done = succeeded(fuse_stack(tmp_path / "shoot", "--output", out, "--report", out))
    assert sorted(path.name for path in out.iterdir()) == sorted(
        [f"{name}.{kind}" for name in sharp for kind in ("png", "json")])
    for name in sharp:
        succeeded(fuse_stack(tmp_path / "shoot" / name, "--output", tmp_path / "alone.png"))
        assert np.array_equal(read(out / f"{name}.png"), read(tmp_path / "alone.png"))
        assert read_report(out / f"{name}.json")["files"] == [f"IMG_000{index}.png" for index in range(3)]
    assert [line.split("  ")[0] for line in done.stdout.splitlines()[1:-1]] == ["ant", "leaf 2", "leaf 10"]
    assert done.stdout.splitlines()[-1] == "3 stacks: 3 fused, 0 there already, 0 failed"
    assert f"fuse_stack: ant: wrote {out / 'ant.png'}: 3 of 3 frames" in done.stderr


def test_it_goes_on_after_a_failure_and_resumes(tmp_path):
    for seed, name in enumerate("abc"):
        bracket(tmp_path / name, seed)
    cut(tmp_path / "b" / "IMG_0001.png")
    stacks = [argument for name in "abc" for argument in ("--stack", tmp_path / name)]
    done = fuse_stack(*stacks, "--output", tmp_path / "out")
    rows, count = table(done)
    assert done.returncode == 2 and count == "3 stacks: 2 fused, 0 there already, 1 failed"
    assert rows["a"] == f"3 of 3 {tmp_path / 'out' / 'a.png'}" and "cut short" in rows["b"] and "failed" in rows["b"]
    assert done.stderr.splitlines()[-1] == "fuse_stack: 1 of 3 stacks failed"
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a.png", "c.png"]

    bracket(tmp_path / "b", 1)
    before = (tmp_path / "out" / "a.png").stat().st_mtime_ns
    rows, count = table(succeeded(fuse_stack(*stacks, "--output", tmp_path / "out")))
    assert count == "3 stacks: 1 fused, 2 there already, 0 failed" and rows["a"].endswith("a.png, there already")
    assert (tmp_path / "out" / "a.png").stat().st_mtime_ns == before
    future = time.time() + 100
    os.utime(tmp_path / "c" / "IMG_0000.png", (future, future))  # a frame that was taken again
    assert table(succeeded(fuse_stack(*stacks, "--output", tmp_path / "out")))[1].startswith("3 stacks: 1 fused, 2 there")


def test_what_was_made_of_other_frames_or_with_other_options_is_made_anew(tmp_path, planes):
    stacks = [argument for seed, name in enumerate("ab") for argument in ("--stack", tmp_path / name)]
    for seed, name in enumerate("ab"):
        bracket(tmp_path / name, seed)

    def count(*options):
        return table(succeeded(fuse_stack(*stacks, "--output", tmp_path / "out", *options)))[1]
    assert count() == "2 stacks: 2 fused, 0 there already, 0 failed"
    assert count() == "2 stacks: 0 fused, 2 there already, 0 failed"
    assert count("--mode", "restored") == "2 stacks: 2 fused, 0 there already, 0 failed"
    assert count("--mode", "restored", "--width", "50") == "2 stacks: 2 fused, 0 there already, 0 failed"
    shutil.copy2(tmp_path / "a" / "IMG_0002.png", tmp_path / "a" / "IMG_0003.png")  # as old as it was
    assert count("--mode", "restored", "--width", "50") == "2 stacks: 1 fused, 1 there already, 0 failed"
    assert count("--rig", planes.rig) == "2 stacks: 2 fused, 0 there already, 0 failed"
    assert count("--rig", planes.rig) == "2 stacks: 0 fused, 2 there already, 0 failed"
    future = time.time() + 100
    os.utime(planes.rig / "optics.yaml", (future, future))  # corrected
    assert count("--rig", planes.rig) == "2 stacks: 2 fused, 0 there already, 0 failed"


def test_files_of_the_user_stay(tmp_path):
    for seed, name in enumerate("ab"):
        bracket(tmp_path / name, seed)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a.json").write_text("my notes")
    done = fuse_stack("--stack", tmp_path / "a", "--stack", tmp_path / "b", "--output", tmp_path / "out", "--report",
                      tmp_path / "out")
    assert done.returncode == 2 and "a.json: is there without a result of this package beside it" in done.stderr
    assert (tmp_path / "out" / "a.json").read_text() == "my notes" and (tmp_path / "out" / "b.json").exists()


def test_stacks_of_one_name(tmp_path):
    for seed, place in enumerate(("one", "two")):
        bracket(tmp_path / place / "stack", seed)
    write_video(tmp_path / "clip.avi", [texture(seed=5)] * 3)
    succeeded(fuse_stack(tmp_path / "one" / "stack", tmp_path / "two" / "stack", tmp_path / "clip.avi", "--output",
                         tmp_path / "out"))
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["clip.png", "one_stack.png", "two_stack.png"]


def test_a_folder_with_many_brackets_of_one_size(tmp_path):
    sharp = [bracket(tmp_path / "photos", seed, 3 * seed) for seed in range(3)]
    done = succeeded(fuse_stack(tmp_path / "photos", "--split", "3", "--output", tmp_path / "out", "--reference", "1"))
    assert table(done)[0] == {f"photos_0{number}": f"3 of 3 {tmp_path / 'out' / f'photos_0{number}.png'}"
                              for number in (1, 2, 3)}
    for number, picture in enumerate(sharp, 1):
        assert cv2.PSNR(read(tmp_path / "out" / f"photos_0{number}.png"), picture) > 30
    write(tmp_path / "photos" / "IMG_0009.png", sharp[2])
    rows, _ = table(succeeded(fuse_stack(tmp_path / "photos", "--split", "3", "--output", tmp_path / "more")))
    assert rows["photos_04"].startswith("1 of 1 ")


def with_times(folder, seconds):
    """Gives the pictures, JPEG, times of exposure."""
    for path, second in zip(sorted(folder.iterdir()), seconds):
        picture, exif = Image.open(path), Image.Exif()
        exif[PHOTO] = {TIME: f"2026:05:01 12:{int(second) // 60:02d}:{int(second) % 60:02d}",
                       FRACTION: f"{round(second % 1 * 100):02d}"}
        picture.save(path, exif=exif, quality=95)


def test_brackets_end_with_a_pause(tmp_path):
    """One scene all the time: only the times tell."""
    for first in (0, 3, 6):
        bracket(tmp_path / "photos", 1, first, "jpg")
    with_times(tmp_path / "photos", [0, 0.4, 0.8, 6, 6.4, 6.8, 61.2, 61.6, 62])
    rows, count = table(succeeded(fuse_stack(tmp_path / "photos", "--split", "gap", "--output", tmp_path / "out")))
    assert [row.split(" /")[0] for row in rows.values()] == ["3 of 3"] * 3 and count.startswith("3 stacks: 3 fused")
    with_times(tmp_path / "photos", range(9))
    with unchanged(tmp_path):
        expect_refusal(fuse_stack(tmp_path / "photos", "--split", "gap", "--output", tmp_path / "again"), "fuse_stack",
                       "no exposure came long after the one before: say --split N")


def test_without_times_brackets_end_with_the_scene(tmp_path):
    for seed in range(3):
        bracket(tmp_path / "photos", seed, 3 * seed)
    for path in sorted((tmp_path / "photos").iterdir()):  # coarse scenes, as photographs are
        write(path, cv2.resize(cv2.resize(read(path), (8, 6), interpolation=cv2.INTER_AREA), SIZE))
    rows, _ = table(succeeded(fuse_stack(tmp_path / "photos", "--split", "gap", "--output", tmp_path / "out")))
    assert [row.split(" /")[0] for row in rows.values()] == ["3 of 3"] * 3


def test_what_is_refused(planes, tmp_path):
    two = [tmp_path / "a", tmp_path / "b"]
    for seed, folder in enumerate(two):
        bracket(folder, seed)
    (tmp_path / "empty").mkdir()
    out = tmp_path / "out"
    with unchanged(tmp_path):
        done = fuse_stack(tmp_path / "no", tmp_path / "none", "--output", out)
        assert done.returncode == 2 and done.stderr.endswith("fuse_stack: 2 of 2 stacks failed\n")
    with unchanged(tmp_path):
        for arguments, complaint in (
                ([*two, "--output", tmp_path / "sharp.png"], "--output names a folder, not a file, where stacks are several"),
                ([*two, "--output", out, *planes.with_depth], "--depth belongs to one scene: fuse its stack alone"),
                ([two[0], "--split", "0", "--output", out], "--split: '0' is neither a number of frames nor gap"),
                ([two[0], "--split", "often", "--output", out], "'often' is neither a number of frames nor gap"),
                ([tmp_path / "empty", "--output", tmp_path / "x.png"], "the folder holds no image")):
            expect_refusal(fuse_stack(*arguments), "fuse_stack", complaint)


def test_no_picture_of_the_user_is_replaced(tmp_path):
    for seed, name in enumerate("ab"):
        bracket(tmp_path / name, seed)
    (tmp_path / "out").mkdir()
    mine = write(tmp_path / "out" / "a.png", texture())
    before = mine.read_bytes()
    done = fuse_stack(tmp_path / "a", tmp_path / "b", "--output", tmp_path / "out")
    assert done.returncode == 2 and "a.png: is there, and no result of this package" in done.stderr
    assert mine.read_bytes() == before and (tmp_path / "out" / "b.png").exists()
