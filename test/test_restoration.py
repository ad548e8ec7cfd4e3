# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mode restored of fuse_stack: nearer to the truth than refined, depth of its own, or refined where something is missing."""
import numpy as np
import pytest

from all_in_focus.files.rig import load_rig
from all_in_focus.files.stack import load_focus
from all_in_focus_lab.metrics.truth import Truth, blur_per_inverse_depth, depth_errors, psnr
from tool_helpers import (expect_refusal, fuse_stack, made_scene, read, read_report, succeeded, without_timings)


@pytest.fixture(scope="module")
def scene():
    return made_scene("--scene", "clutter", "--frames", "6", "--optics", "50,2.8,0.03", "--size", "320x240")


def fuse(scene, folder, mode, *arguments, depth=True, focus=True):
    """The picture and the report."""
    folder.mkdir(exist_ok=True)
    done = succeeded(fuse_stack(
        "--stack", scene / "stack", "--mode", mode, "--output", folder / "fused.png", "--report", folder / "report.json",
        *(["--depth", scene / "depth.png", "--rig", scene / "rig"] if depth else []),
        *(["--focus", scene / "focus.yaml"] if focus else []), *arguments))
    return read(folder / "fused.png"), dict(read_report(folder / "report.json"), said=done.stderr)


def test_restored_is_nearer_to_the_truth_and_brings_its_depth(scene, tmp_path):
    refined, _ = fuse(scene, tmp_path, "refined")
    restored, report = fuse(scene, tmp_path, "restored", "--save-depth", tmp_path / "depth.png")
    truth = Truth.load(scene)
    assert psnr(restored, truth.image, truth.edges) > psnr(refined, truth.image, truth.edges) + 0.4
    assert psnr(restored, truth.image) > psnr(refined, truth.image) + 0.4
    assert report["mode"] == "restored" and report["blur_scale"] == pytest.approx(1, abs=0.1)
    assert report["timing_names"] == ["depth", "segmentation", "fusion", "restoration"]
    assert not any("restored" in note or "optics say" in note for note in report["notes"])
    depth, true_depth = read(tmp_path / "depth.png"), read(scene / "truth_depth.png")
    assert depth.dtype == np.uint16 and depth.shape == true_depth.shape and depth.all()
    assert np.mean(np.abs(depth / true_depth - 1) < 0.1) > 0.85


@pytest.mark.parametrize("missing, depth, focus", [
    ("the focus distances are unknown", True, False), ("the pixel pitch is unknown", False, True)])
def test_without_optics_or_focus_it_says_so_and_is_refined(scene, tmp_path, missing, depth, focus):
    refined, of_refined = fuse(scene, tmp_path, "refined", depth=depth, focus=focus)
    restored, report = fuse(scene, tmp_path, "restored", depth=depth, focus=focus)
    assert np.array_equal(restored, refined)
    said = [note for note in report["notes"] if note.startswith("not restored: ")]
    assert len(said) == 1 and missing in said[0] and "fuse_stack: note: " + said[0] in report["said"]
    report["notes"].remove(said[0])
    assert without_timings(dict(report, said="")) == without_timings(dict(of_refined, said=""))


def test_wrong_optics_are_said(scene, tmp_path):
    _, report = fuse(scene, tmp_path, "restored", "--optics", "50,2,0.03")
    assert report["blur_scale"] == pytest.approx(2 / 2.8, abs=0.1)
    assert any("times as much as the optics say" in note for note in report["notes"])


def test_without_depth_it_is_found_from_the_bracket(scene, tmp_path):
    options = ["--rig", scene / "rig"]
    refined, _ = fuse(scene, tmp_path, "refined", *options, depth=False)
    restored, report = fuse(scene, tmp_path, "restored", *options, depth=False)
    truth = Truth.load(scene)
    assert report["mode"] == "restored"
    assert psnr(restored, truth.image, truth.edges) > psnr(refined, truth.image, truth.edges) + 0.2


def test_beside_thin_things_its_depth_is_right_more_often_than_the_registered_one(tmp_path):
    frames = 8
    scene = made_scene("--scene", "occluders", "--frames", frames, "--size", "400x300")
    fuse(scene, tmp_path, "restored", "--save-depth", tmp_path / "restored.png", "--save-registered", tmp_path / "filled.png")
    rig = load_rig(scene / "rig")
    names = [f"{index:03d}.png" for index in range(frames)]
    focus_mm = [1000 * distance for distance in load_focus(scene / "focus.yaml", names, frames)]
    blur = blur_per_inverse_depth(rig.optics, rig.color.K[0, 0], focus_mm)
    truth = read(scene / "truth_depth.png")
    restored, filled = (depth_errors(read(tmp_path / name), truth, blur)[0] for name in ("restored.png", "filled.png"))
    assert restored < 0.8 * filled


def test_only_restored_has_that_depth(scene, tmp_path):
    done = fuse_stack("--stack", scene / "stack", "--output", tmp_path / "fused.png", "--save-depth", tmp_path / "depth.png")
    expect_refusal(done, "fuse_stack", "--save-depth: there is no depth from the bracket: only --mode restored")
