# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""segment_depth at the command line: the depth-of-field rule, recomputed from depth and labels."""
import cv2
import numpy as np
import pytest

from all_in_focus.msg import Segment
from tool_helpers import (HYPERFOCAL, expect_refusal, fits, max_dof, read, read_report, segment_depth, snapshot, succeeded,
                          unchanged, write)

# Tables 1 and 2 of the paper, mm: min, max, diff, MaxDoF, fits.
GOLDEN = [(2722, 3115, 393, 1526, True), (2417, 2639, 222, 1132, True), (832, 1360, 528, 207, False),
          (2463, 3140, 677, 1186, True), (855, 962, 107, 109, True), (950, 1085, 135, 136, True),
          (1088, 1269, 181, 182, True), (1273, 1412, 139, 257, True)]


def segmented(folder, depth, *options, optics="24,4,0.019"):
    """Labels and report."""
    write(folder / "depth.png", depth.astype(np.uint16))
    done = succeeded(segment_depth("--depth", folder / "depth.png", "--optics", optics, "--output", folder / "l.png",
                                   "--report", folder / "r.json", *options))
    assert done.stdout == done.stderr == ""
    assert set(snapshot(folder)) == {"depth.png", "l.png", "r.json"}
    labels = read(folder / "l.png")
    assert labels.dtype == np.uint16 and labels.shape == depth.shape
    return labels, read_report(folder / "r.json")


def ramp(smallest, greatest):
    """Every millimetre once in each of six rows."""
    return np.tile(np.arange(smallest, greatest + 1), (6, 1))


def rough_scene():
    """0.8 to 4.8 m: a slope with steps, noise and holes, as a sensor has them."""
    random = np.random.default_rng(3)
    depth = np.tile(np.linspace(800, 4800, 120), (90, 1)) + 12 * random.standard_normal((90, 120))
    depth[20:60, 30:50] -= 400
    depth[random.random(depth.shape) < 0.03] = 0
    return np.clip(depth, 0, None).round().astype(np.uint16)


def check_table(depth, labels, report):
    """Every number of the table, from depth and labels alone."""
    assert report["version"] == 1 and report["unknown_area"] == (depth == 0).sum()
    assert np.array_equal(labels == 0, depth == 0)
    table = report["segment_table"]
    assert [row["label"] for row in table] == list(range(1, labels.max() + 1))
    medians = [row["depth_median"] for row in table]
    assert medians == sorted(medians), "near to far"
    for row in table:
        assert set(row) == set(Segment.__slots__)
        values = np.sort(depth[labels == row["label"]].astype(int))
        low, high = int(values[0]), int(values[-1])
        assert row["area"] == len(values) and row["fits"] is bool(fits(low, high))
        expected = {"depth_min": low, "depth_max": high, "depth_median": values[(len(values) - 1) // 2],
                    "diff": high - low, "max_dof": max_dof(low, high), "focus_distance": 2 / (1 / low + 1 / high)}
        for name, value in expected.items():
            if np.isinf(value):
                assert row[name] is None, name
            else:
                assert row[name] == pytest.approx(value / 1000, rel=1e-12), name


@pytest.mark.parametrize("smallest, greatest, diff, dof, one_region", GOLDEN)
def test_golden_values_on_a_ramp(tmp_path, smallest, greatest, diff, dof, one_region):
    depth = ramp(smallest, greatest)
    labels, report = segmented(tmp_path, depth)
    check_table(depth, labels, report)
    assert all(row["fits"] and row["diff"] < row["max_dof"] for row in report["segment_table"])
    if one_region:
        row, = report["segment_table"]
        assert (round(1000 * row["diff"]), round(1000 * row["max_dof"])) == (diff, dof)
    else:
        assert len(report["segment_table"]) > 1
        # As one region all the same, as the paper prints it: a speck is merged whatever the rule says.
        depth = np.full((8, 8), greatest)
        depth[3, 3:6] = smallest
        labels, report = segmented(tmp_path, depth, "--mode", "paper")
        check_table(depth, labels, report)
        row, = report["segment_table"]
        assert (round(1000 * row["diff"]), round(1000 * row["max_dof"]), row["fits"]) == (diff, dof, False)


@pytest.mark.parametrize("mode", ["paper", "refined"])
def test_table_of_a_rough_scene(tmp_path, mode):
    depth = rough_scene()
    labels, report = segmented(tmp_path, depth, "--mode", mode)
    check_table(depth, labels, report)
    table = report["segment_table"]
    if mode == "refined":
        assert all(row["fits"] for row in table)
    for row in table:
        region = (labels == row["label"]).astype(np.uint8)
        assert cv2.connectedComponents(region, connectivity=8)[0] == 2, f"label {row['label']} is in pieces"
        if mode == "paper" and row["area"] < 10:
            around = cv2.dilate(region, np.ones((3, 3))) > region
            assert not labels[around].any(), "only what touches nothing stays small"


def test_refined_regions_cannot_grow(tmp_path):
    """No two neighbours fit one depth of field together."""
    depth = rough_scene()
    labels, report = segmented(tmp_path, depth, "--mode", "refined")
    ranges = {row["label"]: (1000 * row["depth_min"], 1000 * row["depth_max"]) for row in report["segment_table"]}
    pairs = set()
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = labels[:labels.shape[0] - dy, max(0, -dx):labels.shape[1] - max(0, dx)]
        b = labels[dy:, max(0, dx):labels.shape[1] - max(0, -dx)]
        pairs.update(zip(a[(a != b) & (a > 0) & (b > 0)], b[(a != b) & (a > 0) & (b > 0)]))
    assert len(pairs) > 20
    for one, other in pairs:
        assert not fits(min(ranges[one][0], ranges[other][0]), max(ranges[one][1], ranges[other][1]))


def test_beyond_the_hyperfocal_distance_all_is_sharp(tmp_path):
    depth = ramp(int(HYPERFOCAL) + 1, 9000)
    depth[:, -1] = 65534  # 65535 means unknown
    labels, report = segmented(tmp_path, depth)
    check_table(depth, labels, report)
    assert (labels == 1).all() and report["segment_table"][0]["max_dof"] is None


def test_focus_plan_makes_every_region_sharp(tmp_path):
    report = segmented(tmp_path, rough_scene())[1]
    plan = report["focus_plan"]
    limits = [(one["near_limit"], one["focus_distance"], one["far_limit"]) for one in plan]
    assert all(near < focus < far for near, focus, far in limits) and len(limits) > 3
    for row in report["segment_table"]:
        sharp_to = row["depth_min"]
        for near, _, far in limits:
            if near <= sharp_to * (1 + 1e-8):
                sharp_to = max(sharp_to, far)
        assert sharp_to >= row["depth_max"] * (1 - 1e-8)


def test_rule_and_optics_are_reported(tmp_path):
    depth = np.repeat([[2000, 3000]], 5, axis=0)  # 1.26 depths of field apart
    for rule, regions in (("paper", 2), ("full", 1)):
        labels, report = segmented(tmp_path, depth, "--dof-rule", rule)
        assert labels.max() == regions and report["dof_rule"] == rule
    labels, report = segmented(tmp_path, depth, optics="24,8,0.019")
    assert labels.max() == 1
    assert report["optics"] == {"focal_length_mm": 24.0, "aperture": 8.0, "circle_of_confusion_mm": 0.019}


def test_small_regions(tmp_path):
    depth = np.full((9, 9), 3000)
    depth[4, 3:6] = 1000
    for options, regions in ((["--mode", "refined"], 2), (["--mode", "paper"], 1),
                             (["--mode", "paper", "--min-region-size", "3"], 2),
                             (["--mode", "paper", "--min-region-size", "0"], 2)):
        assert segmented(tmp_path, depth, *options)[0].max() == regions, options


def test_picture_of_the_regions(tmp_path):
    """Near is red, unknown black; a legend with metres below."""
    depth = np.full((480, 640), 1000, np.uint16)
    depth[:, 320:], depth[:50] = 4000, 0
    (tmp_path / "in").mkdir()
    segmented(tmp_path / "in", depth, "--save-regions", tmp_path / "regions.png")
    picture = read(tmp_path / "regions.png")
    assert picture.shape[0] > 480 and picture.shape[1:] == (640, 3) and picture.dtype == np.uint8
    assert not picture[10, 10].any() and [picture[470, x].argmax() for x in (5, 635)] == [2, 0]
    legend = picture[480:]
    assert [legend[legend.shape[0] // 4, x].argmax() for x in (0, 639)] == [2, 0]
    assert (legend[legend.shape[0] // 2:] < 128).any()
    segmented(tmp_path / "in", depth // 4000, "--save-regions", tmp_path / "one.png", optics="0.5,4,0.001")


def test_two_runs_are_equal_to_the_byte(tmp_path):
    runs = []
    for _ in range(2):
        segmented(tmp_path, rough_scene())
        runs.append(snapshot(tmp_path))
    assert runs[0] == runs[1]


def test_more_than_65535_regions_are_refused(tmp_path):
    depth = np.tile(np.uint16([[500, 1000], [2000, 5000]]), (128, 129))  # no pixel fits a neighbour
    write(tmp_path / "depth.png", depth)
    with unchanged(tmp_path):
        expect_refusal(segment_depth("--depth", tmp_path / "depth.png", "--optics", "24,4,0.019", "--output",
                                     tmp_path / "l.png"), "segment_depth", "66048 regions")
    labels, report = segmented(tmp_path, depth[:, :254])
    assert len(np.unique(labels)) == len(report["segment_table"]) == labels.size == 65024
