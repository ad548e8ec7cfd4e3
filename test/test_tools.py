# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""fuse_stack at the command line: results, the files it writes, its report."""
import cv2
import numpy as np
import pytest
import yaml

from all_in_focus.msg import FusionReport, Optics, Segment, SegmentChoice
from all_in_focus.files.stack import read_depth
from file_helpers import focus_file, write_video
from tool_helpers import (FAR, NEAR, SIZE, TwoPlanes, fuse_stack, max_dof, normalized_variance, peak_mb, read,
                          read_report, run, run_tool, set_up_boards, snapshot, succeeded, texture, tool,
                          without_timings, write)

OUTPUTS = {"--save-registered": "registered.png", "--save-labels": "labels.png",
           "--save-source-index": "source_index.png", "--save-weights": "weights.png", "--report": "report.json"}


@pytest.fixture
def planes(tmp_path):
    return TwoPlanes(tmp_path / "planes")


def fuse_all(planes, *arguments, outputs=tuple(OUTPUTS), mode="paper"):
    """Runs fuse_stack with all outputs; returns them by name."""
    options = [part for option in outputs for part in (option, planes.output(OUTPUTS[option]))]
    done = succeeded(fuse_stack("--stack", planes.stack, "--output", planes.output("fused.png"), "--mode", mode,
                                *options, *arguments))
    assert set(snapshot(planes.folder / "out")) == {"fused.png", *(OUTPUTS[option] for option in outputs)}
    results = {name[:-len(".png")]: read(planes.output(name)) for name in snapshot(planes.folder / "out")
               if name.endswith(".png")}
    return dict(results, report=read_report(planes.output("report.json")), said=done.stderr)


def fused_by_region(frames, labels):
    """The paper's fusion in numpy: image, source index, {label: (frame, score, margin)}."""
    gray = [cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) for frame in frames]
    index, choices = np.zeros(labels.shape, int), {}
    for label in np.unique(labels):
        region = labels == label
        scores = [normalized_variance(image[region]) for image in gray]
        frame = int(np.argmax(scores))
        second = max(score for other, score in enumerate(scores) if other != frame)
        index[region], choices[int(label)] = frame, (frame, scores[frame], 1 - second / scores[frame])
    return np.choose(index[..., None], frames), index, choices


def check_fusion(results, frames, labels):
    image, index, choices = fused_by_region(frames, labels)
    assert results["fused"].dtype == np.uint8 and np.array_equal(results["fused"], image)
    assert results["source_index"].dtype == np.uint16 and np.array_equal(results["source_index"], index)
    assert [segment["label"] for segment in results["report"]["segments"]] == sorted(choices)
    for segment in results["report"]["segments"]:
        assert set(segment) == set(SegmentChoice.__slots__)
        frame, score, margin = choices[segment["label"]]
        assert segment["frame"] == frame
        assert [segment["score"], segment["margin"]] == pytest.approx([score, margin], rel=1e-9)


# --- what goes in -----------------------------------------------------------------------------------------------------

def test_two_planes_as_printed_in_the_paper(planes):
    results = fuse_all(planes, *planes.with_depth)
    dilated = cv2.dilate(planes.depth, np.ones((3, 3)))  # the farther surface eats one pixel of the nearer
    assert results["registered"].dtype == np.uint16 and np.array_equal(results["registered"], dilated)
    labels = np.where(dilated == NEAR, 1, 2)
    assert results["labels"].dtype == np.uint16 and np.array_equal(results["labels"], labels)
    check_fusion(results, planes.frames, labels)
    wrong = (results["fused"] != planes.truth).any(axis=2)
    assert not np.delete(wrong, SIZE[0] // 2 - 1, axis=1).any()
    assert (results["report"]["mode"], results["report"]["reference"]) == ("paper", 1) and "note:" not in results["said"]


def test_two_planes_refined(planes):
    results = fuse_all(planes, *planes.with_depth, mode="refined")
    assert np.array_equal(results["registered"], planes.depth)
    assert np.array_equal(results["labels"], np.where(planes.left, 1, 2))
    away = np.abs(np.arange(SIZE[0]) - SIZE[0] // 2 + 0.5) > 6
    difference = cv2.absdiff(results["fused"], planes.truth)[:, away]
    assert difference.mean() < 2, "the picture is sharp on both planes"
    assert np.array_equal(results["source_index"][:, away], np.where(planes.left, 1, 2)[:, away])


def test_registered_depth_is_used_as_it_is(planes):
    depth = planes.depth.copy()
    depth[10:20, 5:15] = 0
    write(planes.depth_file, depth)
    results = fuse_all(planes, "--registered-depth", planes.depth_file, "--optics", "24,4,0.019")
    assert np.array_equal(results["registered"], depth)
    labels = np.select([depth == NEAR, depth == FAR], [1, 2])
    assert np.array_equal(results["labels"], labels)
    check_fusion(results, planes.frames, labels)
    assert results["report"]["unknown_area"] == 100
    assert results["report"]["optics"] == {"focal_length_mm": 24.0, "aperture": 4.0, "circle_of_confusion_mm": 0.019}


@pytest.mark.parametrize("given, note", [([], None), (["--optics", "24,4,0.019"], "no depth: the lens is not used"),
                                         (["--rig", "RIG"], "neither depth nor focus distances: the rig is not used")])
def test_it_says_what_was_given_in_vain_and_no_more(planes, given, note):
    arguments = [planes.rig if argument == "RIG" else argument for argument in given]
    done = succeeded(fuse_stack(planes.stack, "--output", planes.output("o.png"), *arguments))
    lines = [line for line in done.stderr.splitlines() if "wrote" not in line]
    assert lines == ([f"fuse_stack: note: {note}"] if note else [])


@pytest.mark.parametrize("mode", ["paper", "refined"])
def test_without_depth_sharpness_decides(planes, mode):
    outputs = ["--report", "--save-source-index", "--save-weights"]
    results = fuse_all(planes, outputs=outputs, mode=mode)
    note = "mode paper needs depth or a label map: fused by sharpness alone"
    report = results["report"]
    assert (note in results["said"]) == (mode == "paper") and report["notes"] == ([note] if mode == "paper" else [])
    assert report["has_labels"] is False
    assert report["segments"] == report["segment_table"] == [] and report["optics"] is None
    assert (report["mode"], report["sharpness_alone"]) == (mode, True)
    assert report["files"] == ["00.png", "01.png", "02.png"] and report["reference"] == 1
    away = np.abs(np.arange(SIZE[0]) - SIZE[0] // 2 + 0.5) > 6
    assert np.mean((results["source_index"] == np.where(planes.left, 1, 2))[:, away]) > 0.99
    assert cv2.absdiff(results["fused"], planes.truth)[:, away].mean() < 2
    if mode == "paper":
        assert np.array_equal(results["fused"], np.choose(results["source_index"][..., None], planes.frames))


def test_picture_of_the_regions(planes):
    outputs = {"--save-regions": "regions.png", "--save-labels": "labels.png"}
    options = [part for option, name in outputs.items() for part in (option, planes.output(name))]
    succeeded(fuse_stack("--stack", planes.stack, "--output", planes.output("fused.png"), *options, *planes.with_depth))
    labels, picture = read(planes.output("labels.png")), read(planes.output("regions.png"))
    assert picture.shape[0] > labels.shape[0] and picture.shape[1] == labels.shape[1]
    near, far = np.argwhere(labels == 1)[-1], np.argwhere(labels == 2)[-1]  # a place that no caption covers
    assert [picture[tuple(near)].argmax(), picture[tuple(far)].argmax()] == [2, 0]  # BGR: red, blue
    planes.refused("--save-regions: there is no region with a depth", "--save-regions", planes.output("no.png"))


def test_check_depth_registers_as_fuse_stack_does(planes):
    """The programs in Python take depth from it."""
    set_up_boards(planes)
    outputs = {name: planes.output(f"{name}.png") for name in ("fused", "measured", "registered")}
    succeeded(fuse_stack("--stack", planes.stack, *planes.with_depth, "--output", outputs["fused"], "--save-measured",
                         outputs["measured"]))
    succeeded(run_tool("check_depth", *planes.with_depth, "--save-registered", outputs["registered"]))
    measured, registered = read(outputs["measured"]), read(outputs["registered"])
    assert np.array_equal(measured, registered) and 0 < np.count_nonzero(registered)


LABEL_OUTPUTS = [option for option in OUTPUTS if option != "--save-registered"]


@pytest.mark.parametrize("unknown, shown, unknown_area", [
    (None, {0: 0, 7: 7, 300: 300}, 0), (0, {0: 0, 7: 7, 300: 300}, 480), (7, {0: 1, 7: 0, 300: 301}, 16 * 48),
    (9, {0: 1, 7: 8, 300: 301}, 0)])
def test_label_map(planes, unknown, shown, unknown_area):
    """Every distinct value is a region, 0 too; the unknown value becomes 0, and the others move out of its way."""
    label_map = np.where(planes.left, 7, 300).astype(np.uint16)
    label_map[:, 16:32], label_map[:10, 16:] = 300, 0
    path = write(planes.folder / "map.png", label_map)
    more = [] if unknown is None else ["--unknown-label", unknown]
    results = fuse_all(planes, "--label-map", path, *more, outputs=LABEL_OUTPUTS)
    labels = np.select([label_map == value for value in shown], shown.values())
    assert results["labels"].dtype == np.uint16 and np.array_equal(results["labels"], labels)
    check_fusion(results, planes.frames, labels)
    report = results["report"]
    assert report["has_labels"] and report["segment_table"] == [] and report["unknown_area"] == unknown_area


def test_label_map_of_8_bits_and_another_size(planes):
    small = np.where(planes.left, 3, 250).astype(np.uint8)[::2, ::2]
    results = fuse_all(planes, "--label-map", write(planes.folder / "map.png", small), outputs=LABEL_OUTPUTS[1:])
    assert np.array_equal(results["fused"], planes.truth)
    check_fusion(results, planes.frames, np.repeat(np.repeat(small, 2, 0), 2, 1))


@pytest.mark.parametrize("optics, expected, regions", [(None, 4.0, 2), ("24,22,0.019", 22.0, 1)])
def test_optics_come_from_the_rig_unless_given(planes, optics, expected, regions):
    results = fuse_all(planes, *planes.with_depth, *(["--optics", optics] if optics else []))
    assert results["report"]["optics"]["aperture"] == expected
    assert len(results["report"]["segment_table"]) == results["labels"].max() == regions


def test_dof_rule(planes):
    write(planes.depth_file, np.where(planes.left, 2000, 3000).astype(np.uint16))  # 1.26 depths of field apart
    for rule, regions in (("paper", 2), ("full", 1)):
        results = fuse_all(planes, *planes.with_depth, "--dof-rule", rule)
        assert results["report"]["dof_rule"] == rule and results["labels"].max() == regions


@pytest.mark.parametrize("reference, expected", [("auto", 1), ("0", 0), ("2", 2)])
def test_reference(planes, reference, expected):
    assert fuse_all(planes, *planes.with_depth, "--reference", reference)["report"]["reference"] == expected


def test_video_with_focus_gives_what_its_decoded_frames_give(planes):
    frames = [cv2.resize(frame, (32, 24)) for frame in planes.frames]
    planes.stack = write_video(planes.folder / "v.avi", frames)
    video = cv2.VideoCapture(str(planes.stack), cv2.CAP_FFMPEG)
    decoded = [video.read()[1] for _ in frames]
    focus = focus_file(planes.folder, "frames: [{focus_mm: 900}, {focus_mm: .inf}]\n")
    results = fuse_all(planes, *planes.with_depth, "--focus", focus)
    labels = cv2.resize(results["labels"], (32, 24), interpolation=cv2.INTER_NEAREST)
    check_fusion(results, decoded, labels)


def test_stack_with_focus_by_name(planes):
    plain = fuse_all(planes, *planes.with_depth)
    focus = focus_file(planes.folder, "frames: [{file: 02.png, focus_mm: 3000.0}, {file: stack/01.png, focus_mm: 1000.0}, "
                                      "{file: 00.png, focus_mm: null}]\n")
    results = fuse_all(planes, *planes.with_depth, "--focus", focus)
    assert np.array_equal(results["fused"], plain["fused"])
    assert f"{focus}: tells the focus distance of 2 of 3 frames" in results["said"]


def test_numbers_count_as_numbers(planes):
    (planes.stack / "00.png").rename(planes.stack / "10.png")
    (planes.stack / "01.png").rename(planes.stack / "2.png")
    results = fuse_all(planes, *planes.with_depth)
    assert [segment["frame"] for segment in results["report"]["segments"]] == [1, 0]  # 02.png, 2.png, 10.png


# --- what comes out ---------------------------------------------------------------------------------------------------

def test_report_mirrors_the_messages(planes):
    report = fuse_all(planes, *planes.with_depth)["report"]
    assert set(report) == set(FusionReport.__slots__) - {"header"} | {
        "version", "files", "dof_rule", "unknown_area", "segment_table"}
    assert set(report["optics"]) == set(Optics.__slots__)
    assert report["version"] == 1 and report["label_stamp"] is None and report["bracket_id"] == 0
    assert [report[f"frames_{what}"] for what in ("seen", "used", "rejected", "missing")] == [3, 3, 0, 0]
    assert len(report["timing_names"]) == len(report["timing_ms"]) and min(report["timing_ms"]) >= 0
    dilated = cv2.dilate(planes.depth, np.ones((3, 3)))
    for row, depth in zip(report["segment_table"], (NEAR, FAR)):
        assert set(row) == set(Segment.__slots__)
        assert row == {"label": 1 if depth == NEAR else 2, "area": int((dilated == depth).sum()), "fits": True,
                       "depth_min": depth / 1000, "depth_max": depth / 1000, "depth_median": depth / 1000, "diff": 0.0,
                       "max_dof": pytest.approx(max_dof(depth, depth) / 1000), "focus_distance": depth / 1000}


def test_weights_show_frame_as_hue_and_margin_as_brightness(planes):
    results = fuse_all(planes, *planes.with_depth)
    palette = cv2.cvtColor(np.uint8([[(0, 220, 255), (75, 220, 255), (150, 220, 255)]]), cv2.COLOR_HSV2BGR)[0]
    margins = {segment["frame"]: segment["margin"] for segment in results["report"]["segments"]}
    sure = np.vectorize(lambda frame: int(255 * margins[frame] + 0.5))(results["source_index"])
    expected = palette[results["source_index"]].astype(int) * (128 + sure // 2)[..., None] // 255
    assert results["weights"].dtype == np.uint8 and np.array_equal(results["weights"], expected)


def test_the_legend_of_the_weights_is_a_picture_of_its_own(planes):
    results, legend = fuse_all(planes, *planes.with_depth), planes.output("legend.png")
    succeeded(fuse_stack("--stack", planes.stack, *planes.with_depth, "--output", planes.output("o.png"),
                         "--save-weights-legend", legend))
    drawn = {tuple(color) for color in read(legend).reshape(-1, 3)}
    hues = cv2.cvtColor(np.uint8([[(0, 220, 255), (75, 220, 255), (150, 220, 255)]]), cv2.COLOR_HSV2BGR)[0]
    assert {tuple(hue) for hue in hues} <= drawn
    assert results["weights"].shape == read(planes.output("o.png")).shape


def test_two_runs_are_equal_to_the_byte(planes):
    runs = []
    for _ in range(2):
        planes.clean_output()
        fuse_all(planes, *planes.with_depth, mode="refined")
        files = snapshot(planes.folder / "out")
        files.pop("report.json")
        runs.append((files, without_timings(read_report(planes.output("report.json")))))
    assert runs[0] == runs[1]


def test_older_outputs_are_replaced(planes):
    for name in ("fused.png", "report.json"):
        planes.output(name).write_text("old")
    fuse_all(planes, *planes.with_depth)
    assert without_timings(read_report(planes.output("report.json")))["frames_used"] == 3


def test_other_endings(planes):
    for name in ("o.tiff", "o.bmp", "o.JPG"):
        succeeded(fuse_stack("--stack", planes.stack, "--output", planes.output(name), *planes.with_depth))
        assert read(planes.output(name)).shape == planes.truth.shape
    succeeded(fuse_stack("--stack", planes.stack, "--output", planes.output("o.png"), "--save-labels",
                         planes.output("l.tif"), *planes.with_depth))
    assert read(planes.output("l.tif")).dtype == np.uint16


def test_help_and_timings(planes):
    for name in ("fuse_stack", "segment_depth"):
        shown = succeeded(run([tool(name), "--help"])).stdout
        assert shown.startswith(f"{name}: ") and "--output" in shown
    done = succeeded(fuse_stack("--stack", planes.stack, "--output", planes.output("o.png"), "--timings"))
    assert done.stdout.count("\n") == 1 and "for 3 frames" in done.stdout


def test_memory_does_not_grow_with_the_stack(tmp_path):
    picture = texture((640, 480))
    peaks = []
    for count in (5, 60):  # 1 MB a frame
        folder = tmp_path / str(count)
        folder.mkdir()
        for index in range(count):
            write(folder / f"{index:03d}.png", np.roll(picture, index, axis=1))
        peaks.append(peak_mb("--stack", folder, "--output", tmp_path / "o.png"))
    assert peaks[1] - peaks[0] < 15, peaks


def test_rig_files_of_camera_calibration_are_read(planes):
    """rows and cols, other keys and another order do not matter."""
    path = planes.rig / "color.yaml"
    camera = yaml.safe_load(path.read_text())
    camera["camera_matrix"] = {"data": camera["camera_matrix"]["data"], "cols": 3, "rows": 3}
    path.write_text(yaml.safe_dump(dict(camera, vendor="x")))
    assert fuse_all(planes, *planes.with_depth)["labels"].max() == 2


def test_what_means_unknown_depth(planes):
    """0 and 65535, or what --invalid-values says."""
    depth = planes.depth.copy()
    depth[10:20, 5:15], depth[20:30, 5:15] = 65535, 2047
    write(planes.depth_file, depth)
    arguments = ["--registered-depth", planes.depth_file, "--optics", "24,4,0.019"]
    for options, unknown in (([], 100), (["--invalid-values", "0,2047,65535"], 200), (["--invalid-values", "0"], 0)):
        results = fuse_all(planes, *arguments, *options, mode="refined")
        assert np.count_nonzero(results["registered"] == 0) == unknown
    for bad in ("x", "1,,2", "70000", "-1"):
        planes.refused("is not a list of mm", *arguments, "--invalid-values", bad)
    assert np.count_nonzero(read_depth(planes.depth_file) == 0) == 100
