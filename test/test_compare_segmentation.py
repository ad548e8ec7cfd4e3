# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Felzenszwalb and Huttenlocher's segmentation beside ours: the paper's tables T1 and T2."""
import cv2
import numpy as np
import pytest
from file_helpers import call
from test_recorded_sample import SWEEP, needs_sweep
from test_segment_depth import GOLDEN
from tool_helpers import OPTICS, fuse_stack, max_dof, read, succeeded, texture, write

from all_in_focus_lab.benchmark import segmentation

LENS = "24,4,0.019"


def tables(*arguments):
    """[(title, rows as dictionaries)] of what compare_segmentation prints."""
    blocks = succeeded(call("compare_segmentation", *arguments)).stdout.strip().split("\n\n")
    found = []
    for title, block in zip(blocks[::2], blocks[1::2]):
        heading, _, *lines = ([cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines())
        found.append((title, [dict(zip(heading, line)) for line in lines]))
    return found


@pytest.mark.parametrize("low, high, diff, dof, fits", GOLDEN)
def test_rows_of_the_paper(low, high, diff, dof, fits):
    region = segmentation.regions(np.array([[1, 1]]), np.array([[low, high]], np.uint16), OPTICS)[0]
    assert (region.area, region.diff_mm, region.fits) == (2, diff, fits)
    assert round(region.max_dof_mm) == dof and region.max_dof_mm == pytest.approx(max_dof(low, high))
    assert segmentation.max_dof(OPTICS, 8000, 9000) == np.inf


def slope_before_wall():
    """A wall at 3 m; before it something whose depth runs from 832 to 1360 mm; a part is unknown."""
    depth = np.full((120, 160), 3000, np.uint16)
    depth[40:, 20:140] = np.linspace(832, 1360, 120).astype(np.uint16)
    depth[60:80, 60:100] = 0
    return depth


def test_an_object_deeper_than_the_depth_of_field(tmp_path):
    """The graph's own criterion keeps it in one piece; the rule of the depth of field cuts it."""
    cv2.imwrite(str(tmp_path / "z.png"), slope_before_wall())
    sheet = tmp_path / "sheet.png"
    (title, theirs), (own_title, ours) = tables("--depth", tmp_path / "z.png", "--optics", LENS, "--sigma", 0,
                                                "--output", sheet)
    assert "1 of 2 regions fit" in title and "100.0 % of the known pixels" in own_title
    assert [(row["Min"], row["Max"], row["Diff < MaxDoF?"]) for row in theirs] == [
        ("832", "1360", "no"), ("3000", "3000", "yes")]
    assert len(ours) >= 4 and all(row["Diff < MaxDoF?"] == "yes" for row in ours)
    for rows in (theirs, ours):
        assert sum(int(row["pixels"]) for row in rows) == np.count_nonzero(slope_before_wall())
        for row in rows:
            assert int(row["Diff"]) == int(row["Max"]) - int(row["Min"])
            assert abs(int(row["MaxDoF"]) - max_dof(int(row["Min"]), int(row["Max"]))) <= 0.5
    assert read(sheet).shape[1] > 3 * 480


def test_unknown_depth_joins_and_parts_nothing():
    depth = slope_before_wall()
    labels = segmentation.graph_segmentation(depth, 4000.0, 0.0, 50)
    assert ((labels == 0) == (depth == 0)).all()
    assert len(np.unique(labels[depth > 0])) == 2
    assert not segmentation.graph_segmentation(np.zeros((9, 9), np.uint16), 4000.0, 0.0, 50).any()


def test_only_the_largest_regions_are_printed():
    labels = np.repeat([1, 2, 3], [5, 1, 9])[None]
    found = segmentation.regions(labels, (labels * 1000).astype(np.uint16), OPTICS)
    assert [line[:3] for line in segmentation.cells(found, 2)[1:]] == [["1", "5", "1000"], ["2", "9", "3000"]]


@needs_sweep
def test_recorded_scene(tmp_path):
    """The scene of the paper's Fig. 6: its slanted panel is one region of the graph, four of ours."""
    for name in "ab":
        write(tmp_path / (name + ".png"), texture((640, 480)))
    registered = tmp_path / "z" / "z.png"
    registered.parent.mkdir()
    succeeded(fuse_stack("--stack", tmp_path, "--rig", SWEEP, "--depth", SWEEP / "depth_raw.png", "--output",
                         registered.parent / "o.png", "--save-registered", registered))
    (_, theirs), (title, ours) = tables("--depth", registered, "--optics", LENS)
    print(*theirs, *ours, sep="\n")
    panel = max((row for row in theirs if int(row["Min"]) < 900), key=lambda row: int(row["pixels"]))
    assert int(panel["Max"]) > 1300 and panel["Diff < MaxDoF?"] == "no"
    assert "100.0 % of the known pixels" in title
    assert sum(int(row["Max"]) < 1500 for row in ours) == 4
