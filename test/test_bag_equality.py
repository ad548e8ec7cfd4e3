# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The method on files and through the real nodes, one scene: fuse_stack, and make_bag with evaluate_bag."""
import contextlib
import shutil
import signal
import sys

import cv2
import numpy as np
import psutil
import pytest

from all_in_focus.image_messages import to_message
from all_in_focus_lab.metrics.truth import Truth, psnr
from bag_helpers import BRIDGE, good_messages, rewritten, write as write_bag
from file_helpers import SCRIPTS, call, cut, start, wait_for, wait_until
from tool_helpers import (check_equality, evaluate_bag, expect_refusal, fuse, fuse_stack, made_scene, read, succeeded,
                          texture, unchanged, write)

FRAMES = 6


class Scene:
    """Files of a made scene, and the bag of it."""

    def __init__(self, folder):
        self.folder = folder
        shutil.copytree(made_scene("--scene", "planes", "--size", "160x120", "--frames", FRAMES, "--noise", 1), folder / "scene")
        self.bag = self.make_bag("sweep.bag")

    def files(self, stack="stack", focus=True):
        scene = self.folder / "scene"
        return ["--depth", scene / "depth.png", "--rig", scene / "rig", "--stack", scene / stack,
                *(["--focus", scene / "focus.yaml"] if focus else [])]

    def make_bag(self, name, *options, **files):
        succeeded(call("make_bag", *self.files(**files), *options, "--output", self.folder / name))
        return self.folder / name

    def check_equality(self, name, bag, evaluate_options, fuse_options, **files):
        """Returns the report."""
        report = check_equality(evaluate_bag(self.folder / f"{name}_bag", bag, *evaluate_options),
                                fuse(self.folder / f"{name}_files", *self.files(**files), *fuse_options))
        assert report["has_labels"] and len(report["segments"]) > 4 and len(report["segment_table"]) > 4
        assert report["frames_used"] + report["frames_rejected"] == FRAMES
        return report


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return Scene(tmp_path_factory.mktemp("equality"))


@pytest.fixture(scope="module")
def bag_without_focus(scene):
    return scene.make_bag("no_focus.bag", "--no-focus")


@pytest.mark.parametrize("mode", ["paper", "refined", "restored"])
def test_nodes_give_the_pixels_of_fuse_stack(scene, mode):
    report = scene.check_equality(mode, scene.bag, ["--mode", mode], ["--mode", mode])
    assert [report["mode"], report["frames_rejected"]] == [mode, 0]
    assert report["reference"] == FRAMES // 2  # so some frames were held


@pytest.mark.parametrize("mode", ["paper", "refined", "restored"])
def test_nodes_give_the_pixels_of_fuse_stack_without_focus_and_with_another_lens(scene, bag_without_focus, mode):
    options = ["--optics", "35,8,0.03", "--mode", mode]
    report = scene.check_equality(f"lens_{mode}", bag_without_focus, [*options, "--bracket-size", FRAMES], options, focus=False)
    assert any("no focus distances" in note for note in report["notes"]) == (mode != "paper")


def test_both_fuse_frames_anew_if_the_camera_was_found_to_move_late(tmp_path):
    folder = made_scene("--scene", "slope", "--size", "320x240", "--frames", 10, "--optics", "35,2.8,0.03", "--noise", 0.7,
                        "--drift", 1)
    files = ["--depth", folder / "depth.png", "--rig", folder / "rig", "--stack", folder / "stack",
             "--focus", folder / "focus.yaml"]
    succeeded(call("make_bag", *files, "--output", tmp_path / "late.bag"))
    report = check_equality(evaluate_bag(tmp_path / "late_bag", tmp_path / "late.bag"), fuse(tmp_path / "late_files", *files))
    assert any("the camera moved" in note for note in report["notes"])
    # 36.7 dB where nine of ten frames are fused as if the camera stood still.
    assert psnr(read(tmp_path / "late_files" / "fused.png"), Truth.load(folder).image) > 37.3


def test_both_leave_out_frames_that_do_not_fit(scene):
    """One before the reference and one behind."""
    stack = scene.folder / "scene" / "rejected"
    shutil.copytree(scene.folder / "scene" / "stack", stack)
    for path in (sorted(stack.iterdir())[index] for index in (1, FRAMES - 2)):
        write(path, texture(read(path).shape[1::-1]))
    bag = scene.make_bag("rejected.bag", stack="rejected")
    report = scene.check_equality("rejected", bag, [], [], stack="rejected")
    assert report["frames_rejected"] == 2
    assert [note.split(":")[0] for note in report["notes"]][:2] == ["frame 1 rejected", f"frame {FRAMES - 2} rejected"]


def test_gray_topics_of_twelve_bits(tmp_path):
    """As cameras for machines send them: 12 bits in messages of 16."""
    results = []
    for encoding, factor, dtype in (("mono8", 1, np.uint8), ("mono16", 16, np.uint16)):
        messages = good_messages()
        for message in messages:
            if message[0] == "/rgb/image":
                gray = cv2.cvtColor(BRIDGE.imgmsg_to_cv2(message[1]), cv2.COLOR_BGR2GRAY)
                message[1] = to_message(gray.astype(dtype) * factor, encoding, message[1].header)
        bag = write_bag(tmp_path / f"{encoding}.bag", messages)
        results.append(read(evaluate_bag(tmp_path / encoding, bag) / "fused.png"))
        succeeded(call("bag_to_stack", bag, "--output", tmp_path / f"{encoding}_files"))
        frame = read(tmp_path / f"{encoding}_files" / "stack" / "000.png")
        assert frame.dtype == dtype and frame.max() > 128 * factor
    plain, deep = results
    assert [plain.dtype, deep.dtype] == [np.uint8, np.uint16]
    assert np.sqrt(np.mean((deep / 257 - plain) ** 2)) < 1


# --- what ends a run --------------------------------------------------------------------------------------------------

@pytest.fixture(scope="module")
def long_bag(tmp_path_factory):
    """A bag that is not over before a test has ended its run."""
    return write_bag(tmp_path_factory.mktemp("long") / "x.bag", good_messages(brackets=30))


class Run:
    """evaluate_bag at work, beside a master that is already there."""

    def __init__(self, bag, folder):
        self.output = folder / "out"
        self.process = start([sys.executable, SCRIPTS / "evaluate_bag", "--bag", bag, "--output", self.output])
        self.family = {}  # command line by process
        self.manager = wait_for(self.process,
                                lambda: self.find("all_in_focus/fusion manager") and self.find("__name:=manager"))

    def find(self, words):
        """The process below evaluate_bag whose command line has these words."""
        for process in psutil.Process(self.process.pid).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                self.family[process] = " ".join(process.cmdline())
        return next((process for process, command in self.family.items() if words in command), None)

    def check_end(self, code, *words):
        """Nothing stays: no process, no folder. One line has these words; none: nothing is printed."""
        out, err = self.process.communicate(timeout=300)
        assert (self.process.returncode, out) == (code, ""), err
        assert len(err.splitlines()) == (1 if words else 0) and all(word in err for word in words), err
        assert len(self.family) >= 7  # roslaunch, master, rosout, manager, three loaders
        assert wait_until(lambda: not any(process.is_running() for process in self.family)), self.family
        assert not self.output.parent.exists() or not list(self.output.parent.iterdir())


@pytest.fixture
def running(long_bag, tmp_path):
    run = Run(long_bag, tmp_path / "results")
    yield run
    run.process.kill()
    run.process.communicate()


def test_a_node_that_dies_is_told_in_one_line(running):
    running.manager.kill()
    running.check_end(2, "evaluate_bag: ", "manager was ended by SIGKILL")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_a_run_with_all_its_nodes(running, number):
    running.process.send_signal(number)
    running.check_end(128 + number)


# --- what cannot be evaluated -----------------------------------------------------------------------------------------

def check_refusal(scene, bag, complaint, *options):
    """An earlier result stays; without one there is no folder."""
    earlier = scene.folder / "earlier"
    (earlier / "bracket_0000").mkdir(parents=True, exist_ok=True)
    (earlier / "bracket_0000" / "fused.png").write_text("an earlier result")
    with unchanged(earlier):
        expect_refusal(call("evaluate_bag", "--bag", bag, "--output", earlier, *options), "evaluate_bag", complaint)


@pytest.mark.parametrize("missing, complaint", [
    ("/depth/image_raw", "no depth image"), ("/rgb/image", "no colour image"),
    ("/depth/camera_info", "no camera info of the depth camera"),
    ("/rgb/camera_info", "no camera info of the colour camera"), ("/tf_static", "no transform")])
def test_bag_without_something_needed(scene, missing, complaint):
    bag = rewritten(scene.bag, scene.folder / "without.bag", lambda topic, message: topic != missing)
    check_refusal(scene, bag, complaint)
    expect_refusal(call("evaluate_bag", "--bag", bag, "--output", scene.folder / "new"), "evaluate_bag", complaint)
    assert not (scene.folder / "new").exists()


def test_what_is_not_a_bag(scene):
    path = scene.folder / "x.bag"
    for content in (b"", b"not a bag", scene.bag.read_bytes()[:5000]):
        path.write_bytes(content)
        check_refusal(scene, path, "x.bag")
    check_refusal(scene, scene.folder / "none.bag", "No such file")
    check_refusal(scene, scene.folder, "is a folder")


@pytest.mark.parametrize("optics", ["0,4,0.03", "35,-1,0.03", "35,4,nan", "35,4", "lens"])
def test_impossible_optics(scene, optics):
    check_refusal(scene, scene.bag, "f,F,coc", "--optics", optics)


def test_focal_length_beyond_the_nearest_depth(scene):
    done = fuse_stack(*scene.files(), "--optics", "900,4,0.03", "--output", scene.folder / "o.png")
    expect_refusal(done, "fuse_stack", "focal length")
    check_refusal(scene, scene.bag, "", "--optics", "900,4,0.03")


def unknown_depth(topic, message):
    if topic == "/depth/image_raw":
        message.data = bytes(len(message.data))


def small_depth(topic, message):
    if topic == "/depth/image_raw":
        message.height, message.data = 100, message.data[:100 * message.step]


def no_focal_length(topic, message):
    if topic == "/rgb/camera_info":
        message.K = (0.0, *message.K[1:])


@pytest.mark.parametrize("change", [unknown_depth, small_depth, no_focal_length])
def test_depth_that_fuse_stack_would_refuse(scene, change):
    check_refusal(scene, rewritten(scene.bag, scene.folder / f"{change.__name__}.bag", change), "")


def test_make_bag_refuses_what_fuse_stack_refuses(scene, tmp_path):
    depth = read(scene.folder / "scene" / "depth.png")
    for name, image in (("8.png", (depth // 256).astype(np.uint8)), ("small.png", depth[:-1]), ("unknown.png", 0 * depth)):
        cv2.imwrite(str(tmp_path / name), image)
    cv2.imwrite(str(tmp_path / "cut.png"), depth)
    cut(tmp_path / "cut.png")
    for name in ("8.png", "small.png", "unknown.png", "cut.png", "none.png"):
        arguments = [*scene.files()[2:], "--depth", tmp_path / name, "--output"]
        with unchanged(tmp_path):
            expect_refusal(call("make_bag", *arguments, tmp_path / "x.bag"), "make_bag", name)
            expect_refusal(fuse_stack(*arguments, tmp_path / "x.png"), "fuse_stack", "" if name == "small.png" else name)
