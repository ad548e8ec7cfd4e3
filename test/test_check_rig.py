# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""check_rig on cards before a wall: finds nothing where the rig is right, and the shift where it is not."""
import re

import cv2
import numpy as np
import pytest

from all_in_focus.calibration.rig_check import contours
from all_in_focus.files.rig import save_rig

from board_rendering import project, true_rig
from file_helpers import call, run_script
from tool_helpers import expect_refusal, succeeded, unchanged

WALL = 3.0  # m
CARDS = [(-0.5, -0.3, 0.24, 0.3, 1.2), (-0.1, -0.35, 0.22, 0.16, 1.5), (0.25, -0.2, 0.26, 0.36, 1.1),
         (-0.35, 0.12, 0.3, 0.2, 1.3), (0.1, 0.12, 0.2, 0.2, 0.9), (0.48, 0.2, 0.3, 0.3, 1.7),
         (-0.75, 0.05, 0.2, 0.5, 1.8), (-0.05, 0.42, 0.3, 0.1, 1.6)]  # left, top, width, height, distance (m)
POLES = [(x, -1.5, 0.06, 3.0, 1.0) for x in (-0.4, -0.25, -0.1, 0.05, 0.2, 0.35)]


def outline(card):
    """Points around a card, close to each other: lenses bend lines."""
    left, top, width, height, z = card
    side = np.linspace(0, 1, 40)
    around = np.concatenate([np.stack([side, 0 * side], 1), np.stack([1 + 0 * side, side], 1),
                             np.stack([1 - side, 1 + 0 * side], 1), np.stack([0 * side, 1 - side], 1)])
    return np.column_stack([left + width * around[:, 0], top + height * around[:, 1], np.full(len(around), z)])


def fill(image, points, value):
    cv2.fillPoly(image, [np.rint(points * 16).astype(np.int32)], value, cv2.LINE_AA if image.ndim == 3 else 8, 4)


def scene(rig, cards):
    """(depth image, colour picture) of cards in the depth camera's frame."""
    rng = np.random.default_rng(0)
    depth = np.full((rig.depth.height, rig.depth.width), 1000 * WALL, np.uint16)
    color = np.full((rig.color.height, rig.color.width, 3), (120, 130, 140), np.uint8)
    for card in sorted(cards, key=lambda card: -card[4]):
        fill(depth, project(rig.depth, outline(card)), int(1000 * card[4]))
        fill(color, project(rig.color, outline(card) @ rig.R.T + rig.t), rng.integers(0, 255, 3).tolist())
    noise = rng.normal(0, 3, color.shape)
    return depth, np.clip(cv2.GaussianBlur(color, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def check(folder, rig, depth, color):
    """The two lines that are printed."""
    save_rig(str(folder / "rig"), rig)
    cv2.imwrite(str(folder / "depth.png"), depth)
    cv2.imwrite(str(folder / "color.png"), color)
    result = succeeded(call("check_rig", "--rig", folder / "rig", "--depth", folder / "depth.png", "--color",
                            folder / "color.png", "--output", folder / "out.png"))
    assert cv2.imread(str(folder / "out.png")).shape[1] == color.shape[1]
    return result.stdout.splitlines()


def shift_in(line):
    """(x, y) and standard deviations that a line tells."""
    return [float(number) for number in re.search(r"\((\S+), (\S+)\) px \+- \((\S+), (\S+)\)", line).groups()]


def test_a_rig_that_fits(tmp_path):
    rig = true_rig()
    numbers, verdict = check(tmp_path, rig, *scene(rig, CARDS))
    assert verdict.startswith("fits: no shift is clearly better")
    assert np.abs(shift_in(verdict)[:2]).max() < 0.7
    agree, best, chance = (float(number) for number in re.findall(r"0\.\d+", numbers))
    assert best >= agree > 2 * chance
    drawn = cv2.imread(str(tmp_path / "out.png"))
    assert (drawn == (0, 140, 255)).all(axis=2).sum() > 500 and (drawn == (255, 120, 40)).all(axis=2).sum() > 500


def test_a_shift_is_found(tmp_path):
    rig = true_rig()
    images = scene(rig, CARDS)
    rig.color.K[:2, 2] -= (4, -2)
    verdict = check(tmp_path, rig, *images)[1]
    assert verdict.startswith("edges fit best when shifted by")
    x, y, *deviations = shift_in(verdict)
    assert abs(x - 4) < 0.7 and abs(y + 2) < 0.7 and max(deviations) < 1


def test_upright_edges_tell_nothing_of_up_and_down(tmp_path):
    rig = true_rig()
    depth, color = scene(rig, POLES)
    rig.color.K[0, 2] -= 3
    verdict = check(tmp_path, rig, depth, color)[1]
    assert "unsure in y, too few level edges" in verdict
    assert verdict.startswith("edges fit best when shifted by") and abs(shift_in(verdict)[0] - 3) < 0.7


def test_a_picture_without_edges_tells_nothing(tmp_path):
    rig = true_rig()
    depth, color = scene(rig, CARDS)
    noise = np.random.default_rng(1).normal(120, 3, color.shape).astype(np.uint8)
    assert check(tmp_path, rig, depth, noise)[1].startswith("cannot tell")


def test_a_depth_image_without_jumps_tells_nothing(tmp_path):
    rig = true_rig()
    depth, color = scene(rig, CARDS)
    assert check(tmp_path, rig, np.zeros_like(depth), color)[1].startswith("cannot tell whether it fits")
    assert check(tmp_path, rig, np.full_like(depth, 2000), color)[0].endswith("(0 border pixels)")


def test_the_background_begins_behind_the_shadow():
    """The colour camera sees it, the depth camera does not: there is no depth."""
    depth = np.full((60, 80), 3000, np.uint16)
    depth[20:40, 20:40] = 1000
    depth[20:40, 40:50] = 0
    found = contours(depth)
    right = found.normal[:, 0] == 1
    assert set(found.at[right, 0]) == {39.5} and set(found.far[right, 0]) == {50}
    left = found.normal[:, 0] == -1
    assert left.any() and np.array_equal(found.far[left, 0], found.at[left, 0] - 0.5)


def test_registered_depth_needs_no_rig(tmp_path):
    rig = true_rig()
    rig.depth, rig.R, rig.t = rig.color, np.eye(3), np.zeros(3)
    depth, color = scene(rig, CARDS)
    cv2.imwrite(str(tmp_path / "z.png"), depth)
    cv2.imwrite(str(tmp_path / "c.png"), color)
    result = run_script("check_rig", "--registered-depth", tmp_path / "z.png", "--color", tmp_path / "c.png",
                        "--output", tmp_path / "o.jpg")
    assert result.returncode == 0 and "fits: no shift" in result.stdout


def test_the_offset_between_a_depth_image_and_its_infrared_picture(tmp_path):
    """As docs/calibration.md measures it."""
    rig = true_rig()
    rig.color, rig.R, rig.t = rig.depth, np.eye(3), np.zeros(3)
    depth, infrared = scene(rig, CARDS)
    cv2.imwrite(str(tmp_path / "depth.png"), np.roll(depth, (-4, -5), axis=(0, 1)))
    cv2.imwrite(str(tmp_path / "ir.png"), infrared[..., 1].astype(np.uint16) * 3 + 50)
    result = call("check_rig", "--registered-depth", tmp_path / "depth.png", "--color", tmp_path / "ir.png",
                  "--output", tmp_path / "o.png")
    x, y, *_ = shift_in(result.stdout)
    assert "edges fit best when shifted by" in result.stdout and abs(x - 5) < 0.7 and abs(y - 4) < 0.7


@pytest.mark.parametrize("change, words", [
    (dict(rig="none"), "depth.yaml: No such file or directory"),
    (dict(depth="color.png"), "expected a 16-bit image with one channel"),
    (dict(color="depth.png"), "color.yaml: 800x600 pixels, but the pictures have 640x480"),
    (dict(output="o.nonsense"), "no image format has this ending"),
    (dict(live=True), "give --rig, --depth and --color"),
])
def test_wrong_input_ends_in_one_line(tmp_path, change, words):
    rig = true_rig()
    save_rig(str(tmp_path / "rig"), rig)
    depth, color = scene(rig, CARDS[:1])
    cv2.imwrite(str(tmp_path / "depth.png"), depth)
    cv2.imwrite(str(tmp_path / "color.png"), color)
    given = {"rig": "rig", "depth": "depth.png", "color": "color.png", "output": "o.png", **change}
    live = ["--live"] if given.pop("live", False) else []
    options = [word for key, name in given.items() for word in (f"--{key}", tmp_path / name)]
    with unchanged(tmp_path):
        expect_refusal(call("check_rig", *live, *options), "check_rig", words)
