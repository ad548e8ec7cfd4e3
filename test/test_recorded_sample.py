# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Real recordings: a Kinect's depth map with a focus sweep of 540 frames, and two pairs of photographs.

They are not part of the repository. Their folder is named by the environment variable ALL_IN_FOCUS_DATA; without it, it
is expected beside the repository.
"""
import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from file_helpers import call, write_video
from tool_helpers import (check_equality, evaluate_bag, fits, fuse, fuse_stack, peak_mb, read, read_report,
                          segment_depth, succeeded)

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("ALL_IN_FOCUS_DATA", str(ROOT.parent / "shared" / "data")))
SWEEP, PAIRS = DATA / "kinect_dslr_sweep", DATA / "fusion_pairs"
VIDEO = SWEEP / "focus_sweep.avi"


def needs(folder, there):
    return pytest.mark.skipif(not there, reason=f"RECORDED DATA NOT TESTED: no {folder}; set ALL_IN_FOCUS_DATA to the folder "
                                                "that holds it")


needs_sweep, needs_pairs = needs(SWEEP, VIDEO.is_file()), needs(PAIRS, PAIRS.is_dir())

INPUT = ["--depth", SWEEP / "depth_raw.png", "--rig", SWEEP, "--stack", VIDEO]
PANEL_FRAME, WALL_FRAME = 369, 410  # sharpest
PANEL_END = 1500  # mm: the near panel is before, everything else behind


@pytest.fixture(scope="module", params=["paper", "refined"])
def fused(request, tmp_path_factory):
    """(mode, folder with what fuse_stack makes of the sweep)."""
    mode = request.param
    return mode, fuse(tmp_path_factory.mktemp("sweep") / mode, *INPUT, "--mode", mode)


def video_frames(first, last):
    video = cv2.VideoCapture(str(VIDEO), cv2.CAP_FFMPEG)
    frames = [video.read()[1] for _ in range(last)]  # in sequence: seeking lands on other frames
    return frames[first:]


def is_textured(frame):
    """Where a frame of the sweep shows something: the greatest part of the wall is blank."""
    gray = cv2.GaussianBlur(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY).astype(np.float32), (0, 0), 1)
    return cv2.GaussianBlur(np.abs(cv2.Laplacian(gray, cv2.CV_32F)), (0, 0), 2) > 2


@needs_sweep
def test_each_part_comes_from_where_it_is_sharp(fused):
    mode, folder = fused
    report = read_report(folder / "report.json")
    assert [report["mode"], report["frames_used"]] == [mode, 540]
    source, labels, depth = (read(folder / f"{name}.png") for name in ("source_index", "labels", "registered"))
    wall = labels == np.bincount(labels.ravel()).argmax()
    assert np.median(depth[wall]) > 2500
    panel = (depth > 0) & (depth < 1040)  # its left part: it stands askew
    frames = video_frames(PANEL_FRAME, WALL_FRAME + 1)
    for part, sharpest, frame in ((panel, PANEL_FRAME, frames[0]), (wall, WALL_FRAME, frames[-1])):
        assert part.mean() > 0.1
        if mode == "refined":  # decides pixel by pixel; what is blank looks the same in all frames
            part = part & is_textured(frame)
            assert part.mean() > 0.05
        quartiles = np.percentile(source[part], (25, 50, 75))
        print(f"{mode}: frame {sharpest} expected, quartiles {quartiles}")
        assert np.abs(quartiles - sharpest).max() <= 10


def edge_distances(picture, mask):
    """Along every row: pixels from the mask's last column to the strongest edge within 12 pixels of it."""
    distances = []
    for values, inside in zip(picture, mask):
        if inside.any():
            last = np.flatnonzero(inside)[-1]
            begin = max(0, last - 12)
            distances.append(begin + int(np.abs(np.diff(values))[begin:last + 13].argmax()) - last)
    return np.array(distances)


@needs_sweep
def test_depth_edges_lie_on_edges_of_the_picture(fused):
    mode, folder = fused
    depth = read(folder / "registered.png")
    gray = cv2.cvtColor(video_frames(PANEL_FRAME, PANEL_FRAME + 1)[0], cv2.COLOR_BGR2GRAY).astype(float)
    panel = (depth > 0) & (depth < PANEL_END)
    right = edge_distances(gray[300:460], panel[300:460])
    top = edge_distances(gray[::-1, 180:500].T, panel[::-1, 180:500].T)
    print(f"{mode}: right edge of the panel {np.median(right):+.1f} px, top {np.median(top):+.1f} px (medians)")
    for distances in (right, top):
        assert len(distances) >= 160 and np.median(np.abs(distances)) <= 4
    shifted = edge_distances(gray[300:460], np.roll(panel, 8, axis=1)[300:460])
    assert np.median(np.abs(shifted)) > 4, "the measure would see a shift"


@needs_sweep
def test_regions(fused):
    mode, folder = fused
    report = read_report(folder / "report.json")
    labels, depth = read(folder / "labels.png"), read(folder / "registered.png")
    table = report["segment_table"]
    print(f"{mode}: {len(table)} regions, the largest {sorted((row['area'] for row in table), reverse=True)[:7]} "
          f"pixels, {report['unknown_area']} pixels unknown")
    assert sum(row["area"] for row in table) + report["unknown_area"] == labels.size
    assert (labels == 0).sum() == report["unknown_area"] == (depth == 0).sum()
    for row in table:
        values = depth[labels == row["label"]]
        assert len(values) == row["area"]
        assert row["fits"] is bool(fits(int(values.min()), int(values.max())))
        assert row["fits"] or mode == "paper"


@needs_sweep
def test_three_planned_frames_show_all_that_the_sweep_does(tmp_path, fused):
    """Every depth is sharp in one of them: docs/dslr.md tells these numbers."""
    mode, folder = fused
    succeeded(segment_depth("--depth", folder / "registered.png", "--optics", "24,4,0.019", "--mode", mode,
                            "--output", tmp_path / "labels.png", "--report", tmp_path / "report.json"))
    plan = read_report(tmp_path / "report.json")["focus_plan"]
    assert [round(one["focus_distance"], 3) for one in plan] == [0.982, 1.254, 2.761]
    depth = read(folder / "registered.png") / 1000
    sharp = [(depth > one["near_limit"] - 1e-6) & (depth < one["far_limit"] + 1e-6) for one in plan]
    print(f"{mode}:", ", ".join(f"{100 * one.sum() / (depth > 0).sum():.0f} %" for one in sharp))
    assert np.array_equal(np.any(sharp, axis=0), depth > 0)


@needs_sweep
def test_nodes_give_the_pixels_of_fuse_stack(tmp_path):
    """Every second frame of the sweep: 270 are more than one byte can number, and more than may wait.
    test_bag_equality.py tests all modes, with fewer frames."""
    half = [*INPUT[:4], "--stack", write_video(tmp_path / "half.avi", video_frames(0, 540)[::2])]
    succeeded(call("make_bag", *half, "--output", tmp_path / "sweep.bag"))
    report = check_equality(evaluate_bag(tmp_path / "bag", tmp_path / "sweep.bag"), fuse(tmp_path / "files", *half))
    (tmp_path / "sweep.bag").unlink()  # 250 MB
    assert [report["mode"], report["frames_used"]] == ["refined", 270]
    assert read(tmp_path / "files" / "source_index.png").max() > 255


@needs_sweep
@pytest.mark.parametrize("depth", [True, False])
def test_memory_does_not_grow_with_the_sweep(tmp_path, depth):
    """20 frames against 140, each 0.9 MB."""
    frames = video_frames(300, 440)
    known = INPUT[:4] if depth else []
    peaks = [peak_mb("--stack", write_video(tmp_path / f"{count}.avi", frames[:count]), *known, "--output", tmp_path / "o.png")
             for count in (20, len(frames))]
    print(f"peak memory: {peaks[0]:.0f} MB for 20 frames, {peaks[1]:.0f} MB for {len(frames)}")
    assert peaks[1] - peaks[0] < 60


@needs_pairs
@pytest.mark.parametrize("scene", ["scene1", "scene2"])
def test_pair_of_photographs(tmp_path, scene):
    """Front and back from the photograph in which they are sharp, pixels as they were."""
    stack = tmp_path / "stack"
    stack.mkdir()
    for name in ("source_a.jpg", "source_b.jpg"):
        shutil.copy(PAIRS / scene / name, stack / name)
    succeeded(fuse_stack("--stack", stack, "--label-map", PAIRS / scene / "label_front.png", "--mode", "paper",
                         "--output", tmp_path / "o.png", "--report", tmp_path / "r.json"))
    chosen = {segment["label"]: segment["frame"] for segment in read_report(tmp_path / "r.json")["segments"]}
    assert chosen == {0: 1, 255: 0}
    front = read(PAIRS / scene / "label_front.png") == 255
    a, b = (cv2.imread(str(stack / name)) for name in ("source_a.jpg", "source_b.jpg"))
    assert np.array_equal(read(tmp_path / "o.png"), np.where(front[..., None], a, b))
