# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mode restored of fuse_stack: nearer to the truth than refined, depth of its own, or refined where something is missing."""
import re

import numpy as np
import pytest
import yaml

from all_in_focus.files.rig import load_rig
from all_in_focus.files.stack import load_focus
from all_in_focus_lab.metrics.truth import Truth, blur_per_inverse_depth, depth_errors, psnr
from tool_helpers import (expect_refusal, fuse_stack, made_scene, read, read_report, succeeded)

PLANES = ["--scene", "planes", "--size", "400x300", "--frames", 8, "--optics", "35,2.8,0.03", "--noise", 0.7]


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
    assert not any("restored" in note or "predicts" in note for note in report["notes"])
    depth, true_depth = read(tmp_path / "depth.png"), read(scene / "truth_depth.png")
    assert depth.dtype == np.uint16 and depth.shape == true_depth.shape and depth.all()
    assert np.mean(np.abs(depth / true_depth - 1) < 0.1) > 0.85


def test_the_frames_alone_are_enough(tmp_path):
    scene = made_scene("--scene", "occluders", "--frames", 8, "--size", "400x300")
    alone = ["--stack", scene / "stack", "--output", tmp_path / "fused.png", "--report", tmp_path / "report.json"]
    pictures = {}
    for mode in ("refined", "restored"):
        succeeded(fuse_stack(*alone, "--mode", mode))
        pictures[mode] = read(tmp_path / "fused.png")
    truth, report = Truth.load(scene), read_report(tmp_path / "report.json")
    assert report["mode"] == "restored" and report["blur_scale"] == 0 and report["optics"] is None
    assert psnr(pictures["restored"], truth.image, truth.edges) > psnr(pictures["refined"], truth.image, truth.edges) + 0.2
    assert psnr(pictures["restored"], truth.image) > psnr(pictures["refined"], truth.image)


def test_the_parallax_of_a_camera_that_moves_says_nothing_about_its_lens(tmp_path):
    scene = made_scene(*PLANES, "--drift", 20)
    _, report = fuse(scene, tmp_path, "refined")
    moved, = [note for note in report["notes"] if "the camera moved" in note]
    assert float(re.search(r"up to ([\d.]+) mm", moved)[1]) == pytest.approx(20, abs=1)
    assert not any("contradict" in note for note in report["notes"])
    assert not any("give depth" in note for note in report["notes"])


def test_restored_is_no_worse_than_refined_if_the_camera_moves(tmp_path):
    scene = made_scene("--scene", "plain", "--size", "400x300", "--frames", 6, "--optics", "35,2,0.03", "--noise", 0.7,
                       "--drift", 20)
    pictures = {mode: fuse(scene, tmp_path, mode)[0] for mode in ("refined", "restored")}
    truth = Truth.load(scene)
    assert psnr(pictures["restored"], truth.image) > psnr(pictures["refined"], truth.image)


def test_without_depth_a_note_says_that_the_camera_moved(tmp_path):
    said = {}
    for name, drift in (("still", []), ("moved", ["--drift", 20])):
        _, report = fuse(made_scene(*PLANES, *drift), tmp_path, "refined", depth=False)
        said[name] = [note for note in report["notes"] if "the camera moved" in note]
        assert all(note in report["said"] for note in said[name])
    assert not said["still"]
    note, = said["moved"]
    assert float(re.search(r"by ([\d.]+) px or more", note)[1]) > 1 and "give depth" in note


@pytest.mark.parametrize("factor, depth", [(4, True), (0.25, True), (4, False)])
def test_a_wrong_f_number_is_said_and_made_up_for(scene, tmp_path, factor, depth):
    refined, _ = fuse(scene, tmp_path, "refined")
    optics = f"50,{2.8 * factor:g},0.03"
    rig = [] if depth else ["--rig", scene / "rig"]
    restored, report = fuse(scene, tmp_path, "restored", "--optics", optics, *rig, depth=depth)
    assert report["blur_scale"] == pytest.approx(factor, rel=0.1)
    way = "more" if factor > 1 else "less"
    expected = rf"the frames are blurred [34].?.? times {way} than 50 mm at F .* predicts: was it F [23].?.?\?"
    said = [note for note in report["notes"] if re.fullmatch(expected, note)]
    assert len(said) == 1, report["notes"]
    truth = Truth.load(scene)
    assert psnr(restored, truth.image) > psnr(refined, truth.image) - 0.05


@pytest.mark.parametrize("size, focal_length, aperture, scale", [
    ("320x240", 24, 2, 0.5), ("320x240", 24, 4, 1), ("320x240", 24, 8, 2), ("640x480", 35, 2, 0.5), ("640x480", 35, 4, 1)])
def test_two_frames_tell_a_wrong_f_number_without_depth(size, focal_length, aperture, scale, tmp_path):
    scene = made_scene("--scene", "planes", "--frames", "2", "--optics", f"{focal_length},4,0.03", "--size", size)
    refined, _ = fuse(scene, tmp_path, "refined", depth=False)
    lens = ["--rig", scene / "rig", "--optics", f"{focal_length},{aperture},0.03"]
    restored, report = fuse(scene, tmp_path, "restored", *lens, depth=False)
    assert report["blur_scale"] == pytest.approx(scale, rel=0.1)
    truth = Truth.load(scene)
    assert psnr(restored, truth.image) > psnr(refined, truth.image) - 0.05


def test_focus_distances_in_reverse_order_are_said_and_cost_refined_nothing(scene, tmp_path):
    listed = yaml.safe_load((scene / "focus.yaml").read_text())
    for frame, focus in zip(listed["frames"], [frame["focus_mm"] for frame in listed["frames"]][::-1]):
        frame["focus_mm"] = focus
    (tmp_path / "reversed.yaml").write_text(yaml.safe_dump(listed))
    wrong = ["--focus", tmp_path / "reversed.yaml"]
    without_depth, _ = fuse(scene, tmp_path, "refined", depth=False, focus=False)
    refined, said = fuse(scene, tmp_path, "refined", *wrong, focus=False)
    truth = Truth.load(scene)
    assert psnr(refined, truth.image) > psnr(without_depth, truth.image) - 0.1
    assert any("contradict" in note or "reverse order" in note for note in said["notes"])
    restored, said = fuse(scene, tmp_path, "restored", *wrong, focus=False)
    assert psnr(restored, truth.image) > psnr(refined, truth.image) + 0.2
    assert any("in reverse order" in note for note in said["notes"])


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


def test_with_depth_the_focus_distances_are_found(tmp_path):
    """In the frames: each is focused on the depth that is sharpest in it."""
    scene = made_scene("--scene", "clutter", "--frames", "8", "--optics", "50,2.8,0.03", "--size", "320x240")
    image = Truth.load(scene).image
    told, _ = fuse(scene, tmp_path, "restored")
    refined, _ = fuse(scene, tmp_path, "refined", focus=False)
    found, report = fuse(scene, tmp_path, "restored", "--save-depth", tmp_path / "depth.png", focus=False)
    assert report["mode"] == "restored" and report["blur_scale"] == pytest.approx(1, abs=0.1)
    assert report["notes"] == ["no focus distances: restored by those at which surfaces of known depth are sharpest, in even "
                               "steps"]
    assert psnr(found, image) > max(psnr(told, image) - 0.6, psnr(refined, image) + 0.4)  # 0.3 less than told
    assert np.mean(np.abs(read(tmp_path / "depth.png") / read(scene / "truth_depth.png") - 1) < 0.1) > 0.85
