# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""No output harms an input, whatever its name; what is no regular file is written to as it is, and never read."""
import json
import os
import shutil
import signal
import stat
import subprocess
import sys

import cv2
import numpy as np
import pytest

from all_in_focus.bag.bag_file import BagError, BagFile
from all_in_focus.files import yaml_file
from all_in_focus.files.output_file import is_result, whole_file, write_picture
from all_in_focus.files.stack import Stack, StackError, read_image
from file_helpers import call, run, run_script
from tool_helpers import (TwoPlanes, expect_refusal, fuse_stack, read, read_report, run_tool, succeeded, tool,
                          unchanged)


@pytest.fixture
def planes(tmp_path):
    return TwoPlanes(tmp_path / "planes")


@pytest.fixture
def bag(planes):
    path = planes.folder / "scene.bag"
    succeeded(call("make_bag", *planes.with_depth, "--stack", planes.stack, "--output", path))
    return path


def names_of(path):
    """Names of one file: plain, by ways about, by links."""
    folder = path.parent
    (folder.parent / "out" / "link.png").symlink_to(path)
    os.link(path, folder.parent / "out" / "hard.png")
    return [path, folder / ".." / folder.name / path.name, folder.parent / "out" / "link.png",
            folder.parent / "out" / "hard.png"]


def test_a_photo_of_the_stack_is_never_replaced(planes):
    for name in names_of(planes.stack / "01.png"):
        with unchanged(planes.folder):
            expect_refusal(fuse_stack("--stack", planes.stack, "--output", name), "fuse_stack",
                           "--output would replace what --stack reads")


def test_neither_is_a_photo_that_is_a_link(planes):
    (planes.folder / "camera").mkdir()
    shutil.move(str(planes.stack / "01.png"), str(planes.folder / "camera" / "7.png"))
    (planes.stack / "01.png").symlink_to(planes.folder / "camera" / "7.png")
    with unchanged(planes.folder):
        expect_refusal(fuse_stack("--stack", planes.stack, "--output", planes.folder / "camera" / "7.png"), "fuse_stack",
                       "--output would replace")


@pytest.mark.parametrize("option, name", [
    ("--save-registered", "depth.png"), ("--save-weights", "stack/00.png"), ("--report", "focus.yaml"),
    ("--report", "rig/optics.yaml"), ("--save-labels", "rig/../depth.png"), ("--report", "stack/02.png")])
def test_no_output_of_fuse_stack_is_an_input(planes, option, name):
    focus = planes.folder / "focus.yaml"
    focus.write_text("frames: [{file: 00.png, focus_mm: 900.0}]\n")
    with unchanged(planes.folder):
        expect_refusal(fuse_stack("--stack", planes.stack, *planes.with_depth, "--focus", focus, "--output",
                                  planes.output("fused.png"), option, planes.folder / name), "fuse_stack",
                       f"{option} would replace")


def test_no_output_of_segment_depth_is_an_input(planes):
    planes.refused_by_segment_depth("--output would replace what --depth reads", output=planes.depth_file)
    planes.refused_by_segment_depth("--save-regions would replace", "--save-regions", planes.depth_file)


def test_two_outputs_are_two_files(planes):
    link = planes.output("link.png")
    link.symlink_to("other.png")  # which is not there yet
    for first, second in (("a.png", "a.png"), ("a.png", "../out/a.png"), ("other.png", "link.png")):
        with unchanged(planes.folder):
            expect_refusal(fuse_stack("--stack", planes.stack, "--output", planes.output(first), "--save-weights",
                                      planes.output(second)), "fuse_stack", "--output and --save-weights are two outputs for")
    done = run_tool("fuse_stack", "--stack", planes.stack, "--output", "a.png", "--save-weights", "./a.png",
                    cwd=str(planes.folder))
    expect_refusal(done, "fuse_stack", "--output and --save-weights are two outputs for")


@pytest.mark.parametrize("program, arguments", [
    ("make_bag", "--depth {0}/depth.png --rig {0}/rig --stack {0}/stack --output {0}/depth.png"),
    ("make_bag", "--depth {0}/depth.png --rig {0}/rig --stack {0}/stack --output {0}/stack/01.png"),
    ("make_bag", "--depth {0}/depth.png --rig {0}/rig --stack {0}/stack --output {0}/rig/color.yaml"),
    ("check_bag", "{0}/scene.bag --json {0}/scene.bag"),
    ("contact_sheet", "{0}/stack/00.png {0}/stack/01.png:near --output {0}/stack/01.png"),
    ("check_rig", "--registered-depth {0}/depth.png --color {0}/stack/00.png --output {0}/stack/00.png"),
    ("check_rig", "--rig {0}/rig --depth {0}/depth.png --color {0}/stack/00.png --output {0}/rig/depth.yaml"),
    ("compare_segmentation", "--depth {0}/depth.png --optics 24,4,0.019 --output {0}/depth.png"),
])
def test_no_output_of_the_other_programs_is_an_input(planes, program, arguments):
    (planes.folder / "scene.bag").write_bytes(b"#ROSBAG V2.0\n")  # refused before anything is read
    with unchanged(planes.folder):
        done = call(program, *arguments.format(planes.folder).split())
    assert (done.returncode, done.stdout) == (2, "") and done.stderr.count("\n") == 1
    assert "is an input of this run" in done.stderr


def test_a_scene_is_not_made_from_what_it_replaces(tmp_path):
    scene = tmp_path / "scene"
    succeeded(call("make_scene", "--scene", "planes", "--size", "64x48", "--frames", "2", "--output", scene))
    with unchanged(tmp_path):
        done = call("make_scene", "--scene", "picture", "--picture", scene / "truth.png", "--depth",
                    scene / "truth_depth.png", "--output", scene)
    assert done.returncode == 2 and "is an input of this run" in done.stderr


# --- results among the photos -----------------------------------------------------------------------------------------

@pytest.mark.parametrize("name", ["sharp.png", "sharp.jpg", "sharp.tif", "sharp.webp", "sharp.bmp", "sharp.ppm"])
def test_a_result_among_the_photos_is_no_frame(planes, name):
    arguments = ["--stack", planes.stack, "--output", planes.stack / name]
    succeeded(fuse_stack(*arguments))
    assert is_result(planes.stack / name)
    first = (planes.stack / name).read_bytes()
    again = succeeded(fuse_stack(*arguments, "--report", planes.output("report.json")))
    assert f"left out {name}: earlier results of this package" in again.stderr
    assert (planes.stack / name).read_bytes() == first
    assert read_report(planes.output("report.json"))["frames_seen"] == 3
    assert Stack(planes.stack).names == ["00.png", "01.png", "02.png"]


def test_results_alone_are_a_stack(planes):
    """As when the stack was fused in slabs."""
    slabs = planes.folder / "slabs"
    slabs.mkdir()
    for name in ("near.png", "far.png"):
        succeeded(fuse_stack("--stack", planes.stack, "--output", slabs / name))
    assert Stack(slabs).names == ["far.png", "near.png"]


def test_results_that_are_the_stack_are_never_replaced(planes):
    slabs = planes.folder / "slabs"
    slabs.mkdir()
    for name in ("near.png", "far.png"):
        succeeded(fuse_stack("--stack", planes.stack, "--output", slabs / name))
    with unchanged(planes.folder):
        for output in (["--output", slabs / "near.png"],
                       ["--output", planes.output("x.png"), "--save-weights", slabs / "far.png"]):
            expect_refusal(fuse_stack("--stack", slabs, *output), "fuse_stack", "would replace what --stack reads")


def test_a_sheet_in_the_folder_is_marked_too(planes):
    sheet = planes.folder / "a.png"
    write_picture(sheet, planes.truth)
    assert is_result(sheet) and np.array_equal(read(sheet), planes.truth)
    shutil.copy(str(sheet), str(planes.stack / "a.png"))
    assert len(Stack(planes.stack)) == 3


def test_pictures_of_another_size_or_of_much_later_are_no_frames(planes):
    cv2.imwrite(str(planes.stack / "03.png"), np.zeros((10, 20, 3), np.uint8))
    stack = Stack(planes.stack)
    assert stack.names == ["00.png", "01.png", "02.png"] and "left out 03.png: their size is not 64x48" in stack.warnings[0]
    shutil.copy(str(planes.stack / "02.png"), str(planes.stack / "03.png"))
    now = os.stat(planes.stack / "00.png").st_mtime
    for index in range(4):
        os.utime(planes.stack / f"{index:02d}.png", (now + index, now + index))
    assert len(Stack(planes.stack)) == 4
    os.utime(planes.stack / "03.png", (now + 3600, now + 3600))
    stack = Stack(planes.stack)
    assert len(stack) == 3 and "left out 03.png: it was made long after all others" in stack.warnings[0]


def test_focus_distances_of_what_is_left_out_do_no_harm(planes):
    succeeded(fuse_stack("--stack", planes.stack, "--output", planes.stack / "03.png"))
    focus = planes.folder / "focus.yaml"
    focus.write_text("frames: [{file: 03.png, focus_mm: 900.0}, {file: 00.png, focus_mm: 1000.0}]\n")
    succeeded(fuse_stack("--stack", planes.stack, "--focus", focus, "--output", planes.output("fused.png")))
    assert Stack(planes.stack, focus).distances[0] == 1.0


# --- what is no regular file ------------------------------------------------------------------------------------------

def test_a_link_stays_and_its_target_is_replaced(planes):
    target, link = planes.output("target.png"), planes.output("link.png")
    link.symlink_to("target.png")
    for _ in range(2):  # the target is not there, then it is
        succeeded(fuse_stack("--stack", planes.stack, "--output", link))
        assert link.is_symlink() and not target.is_symlink() and read(target).shape == planes.truth.shape
    before = target.read_bytes()
    write_picture(link, planes.blurred)
    assert link.is_symlink() and target.read_bytes() != before and np.array_equal(read(target), planes.blurred)


def test_a_link_to_itself_is_no_output(planes):
    link = planes.output("link.png")
    link.symlink_to(link)
    expect_refusal(fuse_stack("--stack", planes.stack, "--output", link), "fuse_stack", "symbolic links")
    expect_refusal(call("contact_sheet", planes.stack / "00.png", "--output", link), "contact_sheet", "symbolic links")
    assert link.is_symlink()


def test_devices_and_pipes_are_written_to(planes):
    fifo = planes.output("fifo")
    os.mkfifo(fifo)
    for device, get in ((fifo, True), ("/dev/stdout", False)):
        reader = subprocess.Popen(["cat", str(device)], stdout=subprocess.PIPE) if get else None
        done = succeeded(run_tool("fuse_stack", "--stack", planes.stack, "--output", planes.output("fused.png"),
                                  "--report", device))
        text = reader.communicate(timeout=60)[0] if get else done.stdout
        assert json.loads(text)["frames_seen"] == 3
    assert stat.S_ISFIFO(os.stat(fifo).st_mode)
    done = run_tool("fuse_stack", "--stack", planes.stack, "--output", "/dev/stdout", universal_newlines=False,
                    errors=None)
    assert np.array_equal(cv2.imdecode(np.frombuffer(done.stdout, np.uint8), 1), read(planes.output("fused.png")))
    succeeded(run_tool("fuse_stack", "--stack", planes.stack, "--output", planes.output("fused.png"), "--report", "/dev/null"))
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_so_does_python(tmp_path):
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    reader = subprocess.Popen(["cat", str(fifo)], stdout=subprocess.PIPE)
    with whole_file(fifo) as working:
        working.write_text("content")
    assert reader.communicate(timeout=60)[0] == b"content" and stat.S_ISFIFO(os.stat(fifo).st_mode)
    with whole_file("/dev/null") as working:
        working.write_text("content")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    code = "from all_in_focus.files.output_file import write_json; print('first'); write_json('/dev/stdout', [1])"
    out = tmp_path / "out.txt"
    with out.open("w") as file:  # a regular file behind /dev/stdout
        subprocess.run([sys.executable, "-c", code], stdout=file, check=True)
    assert out.read_text() == "first\n[\n  1\n]\n" and [path.name for path in tmp_path.iterdir() if path != fifo] == ["out.txt"]


def test_what_nobody_may_write_to_stays(planes):
    protected = planes.output("photo.png")
    protected.write_bytes(b"mine")
    protected.chmod(0o444)
    with unchanged(planes.folder):
        expect_refusal(fuse_stack("--stack", planes.stack, "--output", protected), "fuse_stack", "is write-protected")
        with pytest.raises(PermissionError):
            write_picture(protected, planes.truth)


@pytest.fixture
def alarm():
    """Ends a test that waits for ever."""
    def late(*_):
        raise AssertionError("it waits for a writer of the FIFO")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(30)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def test_no_reader_waits_for_a_fifo(planes, alarm):
    fifo = planes.stack / "03.png"
    os.mkfifo(fifo)
    for reader, error in ((read_image, StackError), (Stack, StackError), (BagFile, BagError)):
        with pytest.raises(error, match="is no regular file"):
            reader(fifo)
    with pytest.raises(ValueError, match="is no regular file"):
        yaml_file.read(fifo, ValueError)
    assert Stack(planes.stack).names == ["00.png", "01.png", "02.png"]
    for option in ("--stack", "--focus", "--label-map"):
        given = {"--stack": planes.stack, "--output": planes.output("fused.png"), option: fifo}
        done = run_tool("fuse_stack", *(part for pair in given.items() for part in pair), timeout=60)
        expect_refusal(done, "fuse_stack", str(fifo))
    fifo.rename(planes.output("03.png"))
    done = run_tool("fuse_stack", "--stack", planes.output(""), "--output", planes.output("fused.png"), timeout=60)
    expect_refusal(done, "fuse_stack", "the folder holds no image")


@pytest.mark.parametrize("program, arguments", [
    ("check_bag", "{0}"), ("bag_to_stack", "{0} --output {1}/o"), ("evaluate_bag", "--bag {0} --output {1}/o"),
    ("contact_sheet", "{0} --output {1}/o.png"), ("check_rig", "--registered-depth {0} --color {0} --output {1}/o.png"),
    ("make_bag", "--depth {0} --rig {1}/rig --stack {1}/stack --output {1}/o.bag")])
def test_no_program_waits_for_a_fifo(planes, program, arguments):
    fifo = planes.folder / "fifo"
    os.mkfifo(fifo)
    done = run_script(program, *arguments.format(fifo, planes.folder).split())
    assert done.returncode == 2 and "is no regular file" in done.stderr


@pytest.mark.parametrize("megabytes", [360, 390, 420, 450])
def test_little_memory_ends_fuse_stack(planes, megabytes):
    """Whether it is enough depends on the libraries. Before main() the loader (127) or the initialisation of a library
    (-SIGABRT) may fail; from then on the program ends with its line."""
    command = f"ulimit -v {megabytes * 1000}; exec \"$@\""
    done = run(["bash", "-c", command, "bash", tool("fuse_stack"), "--stack", planes.stack, "--output",
                planes.output("fused.png")], timeout=120)
    assert done.returncode in (0, 2, 127, -signal.SIGABRT), done
    if done.returncode == 2:
        assert "\nfuse_stack: " in "\n" + done.stderr
    assert done.returncode == 0 or not list((planes.folder / "out").iterdir())


def test_segment_depth_follows_the_same_rules(planes):
    done = succeeded(run_tool("segment_depth", "--depth", planes.depth_file, "--optics", "24,4,0.019", "--output",
                              planes.output("labels.png"), "--report", "/dev/stdout"))
    assert json.loads(done.stdout)["version"] == 1 and is_result(planes.output("labels.png"))
