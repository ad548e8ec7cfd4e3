# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""bag_to_stack: what it writes is what was put into the bag, and fuses to the same pixels."""
import shlex

import cv2
import numpy as np
import pytest
import yaml
from bag_helpers import (COLOR_CAMERA, DEPTH_CAMERA, DIOPTRES, SIZE, changed, compressed, depth_image,
                         frames, good_messages, setting, without, write)
from file_helpers import call, run, run_script
from tool_helpers import check_equality, evaluate_bag, expect_refusal, fuse, read, snapshot, succeeded, tool, unchanged

from all_in_focus.bag.export import millimetres
from all_in_focus.image_messages import to_message
from all_in_focus.bag.writer import write_bag
from all_in_focus.files.output_folder import MARK, read_mark
from all_in_focus.files.rig import Camera, Optics, Rig, load_rig, save_rig
from all_in_focus.files.stack import Stack, load_focus, read_depth

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of cv_bridge
QUATERNION = [0.01, -0.02, 0.03, 0.999299755]
FOCUS_MM = [1000.0 / dioptre for dioptre in DIOPTRES[:-1]] + [float("inf")]


class Files:
    """A scene on disk, as fuse_stack and make_bag take it."""

    def __init__(self, folder):
        self.folder = folder
        color = Camera("color", *SIZE, COLOR_CAMERA.K, [0.1, -0.05, 0.001, 0.002, 0.01])
        depth = Camera("depth", *SIZE, DEPTH_CAMERA.K, [0.1, 0.2, 0, 0, 0.1, 0.1, 0.2, 0.1], "rational_polynomial")
        rig = Rig(depth, color, np.eye(3), [0.0301, -0.01, 1 / 300], Optics(24.0, 4.0, 0.019), "c", "d", QUATERNION)
        save_rig(str(folder / "rig"), rig)
        (folder / "stack").mkdir()
        for index, frame in enumerate(frames()):
            cv2.imwrite(str(folder / "stack" / f"{index:03d}.png"), frame)
        cv2.imwrite(str(folder / "depth.png"), depth_image())
        entries = [{"file": f"{index:03d}.png", "focus_mm": mm} for index, mm in enumerate(FOCUS_MM)]
        (folder / "focus.yaml").write_text(yaml.safe_dump({"frames": entries}))
        stack = Stack(str(folder / "stack"), str(folder / "focus.yaml"))
        write_bag(str(folder / "x.bag"), depth_image(), load_rig(folder / "rig"), stack)

    @property
    def arguments(self):
        return ["--stack", self.folder / "stack", "--depth", self.folder / "depth.png", "--rig", self.folder / "rig",
                "--focus", self.folder / "focus.yaml"]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return Files(tmp_path_factory.mktemp("files"))


def export(bag, folder, *options):
    """(commands, warnings), a list of lines each."""
    done = succeeded(call("bag_to_stack", bag, "--output", folder, *options))
    return done.stdout.splitlines(), done.stderr.splitlines()


def refused(complaint, *arguments):
    expect_refusal(call("bag_to_stack", *arguments), "bag_to_stack", complaint)


def parts(folder):
    """Names in a folder, without the mark that says who wrote it."""
    return sorted(path.name for path in folder.iterdir() if path.name != MARK)


def stack_of(folder):
    return [read(path) for path in sorted((folder / "stack").iterdir())]


def test_round_trip(files, tmp_path):
    done = succeeded(run_script("bag_to_stack", files.folder / "x.bag", "--output", tmp_path / "out"))
    assert done.stderr == "" and parts(tmp_path / "out") == ["depth.png", "focus.yaml", "rig", "stack"]
    out = tmp_path / "out"
    assert snapshot(out / "stack") == snapshot(files.folder / "stack")
    assert np.array_equal(read_depth(str(out / "depth.png")), depth_image())
    names = parts(out / "stack")
    assert [load_focus(str(folder / "focus.yaml"), names, 4) for folder in (out, files.folder)] == [
        [mm / 1000 for mm in FOCUS_MM]] * 2
    one, other = load_rig(str(out / "rig")), load_rig(str(files.folder / "rig"))
    for camera in ("depth", "color"):
        first, second = getattr(one, camera), getattr(other, camera)
        assert first.distortion_model == second.distortion_model and (first.width, first.height) == SIZE
        assert all(np.array_equal(getattr(first, name), getattr(second, name)) for name in "KDRP")
    assert np.array_equal(one.R, other.R) and np.array_equal(one.t, other.t) and one.optics == other.optics
    poses = [yaml.safe_load((folder / "rig" / "extrinsics.yaml").read_text()) for folder in (out, files.folder)]
    assert poses[0] == poses[1] and poses[0]["rotation"] == QUATERNION


def test_the_same_pixels(files, tmp_path):
    """fuse_stack on the original, on the export by the printed command, and the nodes on the bag."""
    (command,), warnings = export(files.folder / "x.bag", tmp_path / "out")
    words = shlex.split(command)
    assert words[:3] == ["rosrun", "all_in_focus", "fuse_stack"] and warnings == []
    succeeded(run([tool("fuse_stack"), *words[3:]]))
    original = fuse(tmp_path / "original", *files.arguments)
    exported = fuse(tmp_path / "exported", *words[3:words.index("--output")])
    assert np.array_equal(read(tmp_path / "out" / "fused.png"), read(original / "fused.png"))
    for name in parts(original):
        if name.endswith(".png"):
            assert np.array_equal(read(exported / name), read(original / name)), name
    assert check_equality(evaluate_bag(tmp_path / "evaluated", files.folder / "x.bag"), exported)["has_labels"]
    export(files.folder / "x.bag", tmp_path / "out", "--force")  # fused.png is no obstacle
    assert parts(tmp_path / "out") == ["depth.png", "focus.yaml", "rig", "stack"]


def test_brackets(tmp_path):
    messages = good_messages(brackets=3)
    number = iter(range(3))
    changed("/depth/image_raw", lambda message, _: to_message(
        depth_image() + np.uint16(next(number)), "16UC1", message.header))(messages)
    bag = write(tmp_path / "x.bag", messages)
    commands, _ = export(bag, tmp_path / "all", "--bracket", "all")
    assert parts(tmp_path / "all") == [f"bracket_{number:04d}" for number in range(3)]
    for number, command in enumerate(commands):
        assert f"bracket_{number:04d}/stack" in command
        depth = read(tmp_path / "all" / f"bracket_{number:04d}" / "depth.png")
        assert np.array_equal(depth, depth_image() + number)
    export(bag, tmp_path / "one", "--bracket", 2)
    one = snapshot(tmp_path / "one")
    assert one.pop(MARK) and one == snapshot(tmp_path / "all" / "bracket_0002")
    assert read_mark(tmp_path / "all")["program"] == "bag_to_stack"
    refused("there is no bracket 3: it has 3, counted from 0", bag, "--output", tmp_path / "two", "--bracket", 3)


def test_frames_are_those_of_their_bracket(tmp_path):
    """Without focus messages, by gaps; nodes then take the first frame as reference."""
    bag = write(tmp_path / "x.bag", without("/rgb/focus")(good_messages(brackets=2)))
    (command,), warnings = export(bag, tmp_path / "out", "--bracket", 1)
    assert all(np.array_equal(*pair) for pair in zip(stack_of(tmp_path / "out"), frames()))
    assert "--reference 0" in command and "--focus" not in command
    assert warnings == [f"bag_to_stack: warning: {tmp_path / 'out'}: no focus distances are known: no focus.yaml"]
    export(bag, tmp_path / "two", "--bracket-size", 2, "--bracket", "all")
    assert len(parts(tmp_path / "two")) == 4 and len(stack_of(tmp_path / "two" / "bracket_0003")) == 2
    export(bag, tmp_path / "never", "--bracket-gap", 0, "--bracket-size", 0, "--bracket", "all")
    assert len(stack_of(tmp_path / "never" / "bracket_0000")) == 8 and parts(tmp_path / "never") == ["bracket_0000"]
    for option, value in (("--bracket-size", -1), ("--bracket-size", 2.5), ("--bracket-size", 65535), ("--bracket-gap", -1),
                          ("--bracket-gap", "x"), ("--bracket-gap", 3601), ("--label-max-age", 3601),
                          ("--invalid-values", "[0,65536]"), ("--invalid-values", "[0,-1]")):
        refused(f"argument {option}: '{value}': expected", bag, "--output", tmp_path / "none", option, value)


@pytest.mark.parametrize("damage, warning_text, left, option", [
    (without("/depth/image_raw"), "no depth: nothing on /depth/image_raw", ["focus.yaml", "stack"], None),
    (setting("/depth/image_raw", encoding="mono8"), "no depth: depth has encoding", ["focus.yaml", "stack"], None),
    (without("/tf_static"), "no rig, so depth.png is of no use", ["depth.png", "focus.yaml", "stack"], None),
    (without("/rgb/camera_info"), "there is no camera info", ["depth.png", "focus.yaml", "stack"], None),
    (without("/rgb/optics"), "does not say what the lens was", ["depth.png", "focus.yaml", "rig", "stack"],
     "--optics")])
def test_missing_parts_are_told(tmp_path, damage, warning_text, left, option):
    (command,), (warning,) = export(write(tmp_path / "x.bag", damage(good_messages())), tmp_path / "out")
    assert warning_text in warning and parts(tmp_path / "out") == left
    assert ("--depth" in command) == ("rig" in left) and (option is None or option in command)
    succeeded(run([tool("fuse_stack"), *shlex.split(command)[3:]]))


def test_a_lens_given(tmp_path):
    bag = write(tmp_path / "x.bag", good_messages())
    export(bag, tmp_path / "out", "--optics", "35,8,0.03")
    assert load_rig(str(tmp_path / "out" / "rig")).optics == Optics(35.0, 8.0, 0.03)


def test_pixels_as_the_nodes_get_them(tmp_path):
    """Other encodings, rows with padding, depth in metres with everything that means unknown."""
    random = np.random.default_rng(3)
    metres = random.uniform(0.3, 5, SIZE[::-1]).astype(np.float32)
    metres[0, :7] = [np.nan, np.inf, -np.inf, -1, 0, 65.6, 2.0474]
    expected = np.floor(metres.astype(np.float32) * np.float32(1000) + np.float32(0.5))
    expected[0, :7] = 0
    messages = changed("/depth/image_raw", lambda message, _: to_message(metres, "32FC1", message.header))(
        good_messages())

    def padded(message, number):
        if number == 1:
            message.encoding = "rgb8"
        elif number == 2:
            rows = np.frombuffer(message.data, np.uint8).reshape(SIZE[1], -1)
            message.step += 13
            message.data = np.hstack([rows, random.integers(0, 256, (SIZE[1], 13), np.uint8)]).tobytes()
    bag = write(tmp_path / "x.bag", changed("/rgb/image", padded)(messages))
    export(bag, tmp_path / "out", "--invalid-values", "[0,2047]")
    pictures = frames()
    pictures[1] = pictures[1][..., ::-1]
    assert all(np.array_equal(*pair) for pair in zip(stack_of(tmp_path / "out"), pictures))
    expected[expected == 2047] = 0
    assert np.array_equal(read(tmp_path / "out" / "depth.png"), expected)


def test_compressed_color_and_frames_that_do_not_fit(tmp_path):
    messages = changed("/rgb/image", compressed)(good_messages())
    messages = [["/rgb/image/compressed" if topic == "/rgb/image" else topic, *rest] for topic, *rest in messages]
    changed("/rgb/image/", lambda message, number: number == 1 and setattr(message, "data", b"nonsense"))(messages)
    _, (warning,) = export(write(tmp_path / "x.bag", messages), tmp_path / "out")
    assert "frame 1 left out" in warning and parts(tmp_path / "out" / "stack") == ["000.png", "002.png", "003.png"]
    assert np.array_equal(stack_of(tmp_path / "out"), np.array(frames())[[0, 2, 3]])


def test_folders_that_are_there(tmp_path):
    bag = write(tmp_path / "x.bag", good_messages(brackets=2))
    (tmp_path / "empty").mkdir()
    export(bag, tmp_path / "empty")
    with unchanged(tmp_path):
        refused("is not empty", bag, "--output", tmp_path / "empty")
        refused("is an input of this run", bag, "--output", bag)
        refused("No such file", bag, "--output", tmp_path / "none" / "out")
        refused("was not written by bag_to_stack", bag, "--output", tmp_path, "--force")
    export(bag, tmp_path / "empty", "--bracket", "all", "--force")
    assert parts(tmp_path / "empty") == ["bracket_0000", "bracket_0001"] and parts(tmp_path) == ["empty", "x.bag"]


def test_nothing_is_left_behind(tmp_path):
    (tmp_path / "text.bag").write_text("not a bag")
    write(tmp_path / "blind.bag", without("/rgb/image")(good_messages()))
    write(tmp_path / "odd.bag", setting("/rgb/image", encoding="8UC3")(good_messages()))
    write(tmp_path / "pairs.bag", setting("/rgb/image", encoding="yuv422", width=33)(good_messages()))
    with unchanged(tmp_path):
        for name, complaint in (("none.bag", "No such file"), ("text.bag", "not a bag"), ("blind.bag", "no colour image"),
                                ("odd.bag", "frame 0 left out: [8UC3]"),
                                ("pairs.bag", "frame 0 left out: yuv422 tells pairs of pixels, but the width is 33")):
            refused(complaint, tmp_path / name, "--output", tmp_path / "out")
        refused("expected a number", tmp_path / "odd.bag", "--output", tmp_path / "out", "--bracket", "-1")


def test_distances_in_millimetres():
    for value in [855.0, 1000 / 0.65, 1e-3, 123456.789, *np.random.default_rng(0).uniform(100, 9000, 200)]:
        assert millimetres(value / 1000) / 1000 == value / 1000
    assert millimetres(0.855) == 855.0 and millimetres(float("inf")) == float("inf")
