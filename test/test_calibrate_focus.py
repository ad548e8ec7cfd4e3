# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_focus on a slanted board that is photographed at known distances, and the programs that take its table."""
import math

import cv2
import numpy as np
import pytest

from all_in_focus.calibration.focus_curve import Sharpness, dioptres_of_registered, fit, peak_of
from all_in_focus.files import yaml_file
from all_in_focus.files.focus_table import FocusTable
from all_in_focus.files.rig import Camera, Rig, save_rig
from all_in_focus.files.stack import Stack, focus_of_arrivals, load_focus
from file_helpers import call, run_script
from tool_helpers import expect_refusal, fuse_stack

SIZE = (480, 320)
NEAR, FAR = 1.4, 0.3  # 1/m, of the board's ends
CAMERA = Camera.pinhole("camera", *SIZE, 500.0, 500.0, 239.5, 159.5)
BLUR = 12.0  # pixels of blur (standard deviation) for a dioptre
# The lens is not quite linear, and goes from nearer than the board to farther.
FOCUS = [1.55 - 0.11 * step - 0.0015 * step ** 2 for step in range(11)]


def read(path):
    return FocusTable.of(yaml_file.read(path, ValueError), path)


def board():
    """Registered depth, mm."""
    dioptres = np.tile(np.linspace(NEAR, FAR, SIZE[0]), (SIZE[1], 1))
    return np.rint(1000 / dioptres).astype(np.uint16)


def photograph(depth, focus, gain=1.0):
    """The board, focused at a distance in dioptres: each column is blurred as its distance says."""
    texture = np.random.default_rng(0).uniform(40, 200, (SIZE[1], SIZE[0])).astype(np.float32)
    texture = cv2.GaussianBlur(texture, (0, 0), 0.7)
    blur = BLUR * np.abs(1000.0 / depth[0] - focus)
    levels = np.arange(0, blur.max() + 0.25, 0.25)
    blurred = np.array([cv2.GaussianBlur(texture, (0, 0), max(0.3, level)) for level in levels])
    picture = blurred[np.rint(blur / 0.25).astype(int), :, np.arange(SIZE[0])].T
    noise = np.random.default_rng(round(focus * 1000)).normal(0, 1, picture.shape)
    return cv2.cvtColor(np.clip(gain * picture + noise, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("board")
    (folder / "stack").mkdir()
    for index, focus in enumerate(FOCUS):  # the aperture's light changes, too
        cv2.imwrite(str(folder / "stack" / f"{index:02}.png"), photograph(board(), focus, 1 - 0.02 * index))
    cv2.imwrite(str(folder / "depth.png"), board())
    done = run_script("calibrate_focus", "--stack", folder / "stack", "--registered-depth", folder / "depth.png", "--first", 4,
                      "--step", 3, "--output", folder / "table.yaml", "--plot", folder / "plot.png")
    assert done.returncode == 0, done.stderr
    return folder


def test_distances_are_those_of_the_lens(scene):
    table = read(scene / "table.yaml")
    assert [row["step"] for row in table.table] == [4 + 3 * index for index in range(len(FOCUS))]
    for index, focus in enumerate(FOCUS):
        assert 1 / table.distance(index) == pytest.approx(focus, abs=0.03)  # a quarter of a step
    assert cv2.imread(str(scene / "plot.png")).std() > 5


def test_depth_of_the_depth_camera_is_registered(scene, tmp_path):
    save_rig(tmp_path / "rig", Rig(CAMERA, CAMERA, np.eye(3), [0.0, 0.0, 0.0], None, "color", "depth"))
    done = call("calibrate_focus", "--stack", scene / "stack", "--depth", scene / "depth.png", "--rig", tmp_path / "rig",
                "--first", 4, "--step", 3, "--output", tmp_path / "table.yaml")
    assert done.returncode == 0, done.stderr
    assert [read(path).distance(5) for path in (tmp_path / "table.yaml", scene / "table.yaml")] == pytest.approx(
        [1 / FOCUS[5]] * 2, rel=0.03)


def test_depth_that_is_unknown_everywhere_is_named(scene, tmp_path):
    save_rig(tmp_path / "rig", Rig(CAMERA, CAMERA, np.eye(3), [0.0, 0.0, 0.0], None, "color", "depth"))
    cv2.imwrite(str(tmp_path / "none.png"), np.zeros(SIZE[::-1], np.uint16))
    for depth in (["--registered-depth", tmp_path / "none.png"], ["--depth", tmp_path / "none.png", "--rig", tmp_path / "rig"]):
        done = call("calibrate_focus", "--stack", scene / "stack", *depth, "--output", tmp_path / "table.yaml")
        expect_refusal(done, "calibrate_focus", "none.png: no pixel of the pictures gets a depth")


def test_beyond_the_board_the_table_goes_on(scene):
    """Without the board's near quarter no tile is sharpest in the first frames."""
    sharpness, depth = Sharpness(), board()
    depth[1000 / np.maximum(depth, 1) > 1.1] = 0
    for focus in FOCUS:
        sharpness.add(photograph(board(), focus))
    curve = fit(sharpness, dioptres_of_registered(depth, sharpness.grid()))
    assert curve.span()[1] < FOCUS[3]
    table = curve.table(0, 1)
    assert [row["step"] for row in table] == list(range(len(FOCUS)))
    assert [1000 / row["mm"] for row in table] == pytest.approx(FOCUS, abs=0.06)  # half a step


def test_every_program_takes_the_table(scene):
    distances = Stack(scene / "stack", scene / "table.yaml").distances
    assert 1 / distances[5] == pytest.approx(FOCUS[5], abs=0.03)
    arrived = focus_of_arrivals(scene / "table.yaml")
    assert arrived("whatever.jpg", 5) == distances[5] and math.isnan(arrived("whatever.jpg", 99))
    report = scene / "report.json"
    done = fuse_stack("--stack", scene / "stack", "--registered-depth", scene / "depth.png", "--optics", "50,2,0.03",
                      "--focus", scene / "table.yaml", "--output", scene / "fused.png", "--report", report)
    assert done.returncode == 0, done.stderr
    assert "no focus distances" not in done.stderr + report.read_text()


def test_a_scene_that_tells_nothing_is_refused():
    depth = np.full(SIZE[::-1], 1200, np.uint16)
    sharpness = Sharpness()
    for focus in FOCUS:
        sharpness.add(photograph(depth, focus))
    with pytest.raises(ValueError, match="slanted board or a deeper scene"):
        fit(sharpness, dioptres_of_registered(depth, sharpness.grid()))
    with pytest.raises(ValueError, match="tiles of the picture have one distance"):
        fit(sharpness, dioptres_of_registered(np.zeros_like(depth), sharpness.grid()))


def test_depth_of_another_scene_is_refused():
    sharpness = Sharpness()
    for focus in FOCUS:
        sharpness.add(photograph(board(), focus))
    shuffled = np.random.default_rng(0).permutation(SIZE[0] // 60)
    strips = board().reshape(SIZE[1], -1, 60)[:, shuffled].reshape(SIZE[1], -1)
    with pytest.raises(ValueError, match="do not agree"):
        fit(sharpness, dioptres_of_registered(strips, sharpness.grid()))


@pytest.mark.parametrize("values, peak", [
    ([1, 2, 4, 2, 1], 2.0), ([1, 4, 4, 1], 1.5), ([4, 3, 2, 1], math.nan), ([1, 2, 3, 3], math.nan), ([3, 3, 3], math.nan),
    ([0, 0, 0], math.nan)])
def test_the_peak_lies_between_frames_that_are_less_sharp(values, peak):
    assert peak_of(np.array(values, float)) == pytest.approx(peak, abs=0.01, nan_ok=True)


def test_tables_that_cannot_be_right(tmp_path):
    path = tmp_path / "table.yaml"
    for text, complaint in (("focus_table: [{step: 0, mm: 500}]", "two steps or more"),
                            ("focus_table: 3", "expected"),
                            ("focus_table: [{step: 0, mm: 500}, {step: 9.5, mm: 900}]", "expected"),
                            ("focus_table: [{step: 0, mm: 500}, {step: .inf, mm: 900}]", "expected"),
                            ("focus_table: [{step: 0, mm: 500}, {step: true, mm: 900}]", "expected"),
                            ("{step: 0.5, focus_table: [{step: 0, mm: 500}, {step: 9, mm: .inf}]}", "step: expected a whole")):
        path.write_text(text)
        with pytest.raises(ValueError, match=complaint):
            load_focus(path, None, 3)
    FocusTable([{"step": 0, "mm": 500}, {"step": 9, "mm": math.inf}]).save(path)
    assert read(path).distance(9) == math.inf


def test_usage():
    expect_refusal(call("calibrate_focus", "--output", "t.yaml"), "calibrate_focus")
    for text in ("two", "inf", "1.5"):
        done = call("calibrate_focus", "--live", "--step", text, "--output", "t.yaml")
        expect_refusal(done, "calibrate_focus", f"argument --step: '{text}': expected a whole number")
