# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bad options, depth and rig of fuse_stack and segment_depth: exit code 2, one line that says why, nothing written."""
import os
import shutil
import struct
import zlib

import numpy as np
import pytest
import yaml

from file_helpers import cut
from tool_helpers import (SIZE, TwoPlanes, expect_refusal, fuse_stack, read_report, segment_depth, set_up_boards, succeeded,
                          texture, write)


@pytest.fixture
def planes(tmp_path):
    planes = TwoPlanes(tmp_path / "planes")
    planes.output("old.png").write_text("an earlier result")
    return planes


# --- options ----------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("arguments, complaint", [
    ([], "required but missing"), (["--stack", "x"], "'--output' is required"),
    (["--output", "x.png"], "'--stack' is required"), (["--stack"], "required argument"),
    (["--stack", "x", "--output", "y.png", "--reference"], "required argument")])
def test_missing_options(arguments, complaint):
    expect_refusal(fuse_stack(*arguments), "fuse_stack", complaint)


@pytest.mark.parametrize("arguments, complaint", [
    (["--depth", "x", "--optics", "24,4,0.019"], "'--output' is required"),
    (["--depth", "x", "--output", "y"], "'--optics' is required"),
    (["--optics", "24,4,0.019", "--output", "y"], "'--depth' is required")])
def test_missing_options_of_segment_depth(arguments, complaint):
    expect_refusal(segment_depth(*arguments), "segment_depth", complaint)


@pytest.mark.parametrize("arguments, complaint", [
    (["--sharp"], "unrecognised option '--sharp'"), (["--refer", "1"], "unrecognised option"), (["-x"], "-x"),
    (["spare"], "positional"), (["--mode", "best"], "none of paper, refined, restored"),
    (["--dof-rule", "half"], "neither paper nor full"), (["--mode", "paper", "--mode", "paper"], "more than once"),
    (["--reference", "3"], "frames 0 to 2"), (["--reference", "-1"], "neither auto nor an index"),
    (["--reference", "1x"], "neither auto nor an index"), (["--reference", "9" * 30], "neither auto nor an index"),
    (["--unknown-label", "x"], "unknown-label"), (["--focus", ""], "--focus is empty"),
    (["--save-labels", "l.png"], "there is no label image"), (["--save-registered", "r.png"], "there is no depth"),
    (["--timings=1"], "timings")])
def test_options(planes, arguments, complaint):
    planes.refused(complaint, *arguments)


def test_sources_of_depth_exclude_each_other(planes):
    label_map = write(planes.folder / "map.png", planes.left.astype(np.uint8))
    planes.refused("give one of", *planes.with_depth, "--label-map", label_map)
    planes.refused("give one of", *planes.with_depth, "--registered-depth", planes.depth_file)
    planes.refused("needs --rig", "--depth", planes.depth_file)
    planes.refused("--optics f,F,coc is needed", "--registered-depth", planes.depth_file)


@pytest.mark.parametrize("optics, complaint", [
    ("0,4,0.019", "focal length"), ("24,0,0.019", "aperture"), ("24,4,0", "circle of confusion"),
    ("-24,4,0.019", "focal length"), ("24,-4,0.019", "aperture"), ("24,4,-0.019", "circle of confusion"),
    ("nan,4,0.019", "--optics"), ("24,inf,0.019", "--optics"), ("24,4", "is not f,F,coc"), ("24,4,0.019,1", "f,F,coc"),
    ("24;4;0.019", "is not f,F,coc"), ("a,b,c", "is not f,F,coc"), ("24,4,0.019mm", "f,F,coc"), ("", "--optics"),
    ("1000,4,0.019", "not smaller than the nearest depth"), ("9999,4,0.019", "nearest depth"),
    ("1e300,4,0.019", "must be 0.1 to 10000")])
def test_optics(planes, optics, complaint):
    planes.refused(complaint, *planes.with_depth, "--optics", optics)
    planes.refused_by_segment_depth(complaint, optics=optics)


def test_negative_region_size(planes):
    planes.refused_by_segment_depth("min_region_size is negative", "--min-region-size", "-1")
    planes.refused_by_segment_depth("min-region-size", "--min-region-size", "x")
    planes.refused_by_segment_depth("none of paper, refined, restored", "--mode", "best")


# --- depth and label maps ---------------------------------------------------------------------------------------------

def png(width, height, bits=16, rows=b""):
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


BAD_DEPTHS = {
    "8 bit": (lambda path: write(path, np.full(SIZE[::-1], 9, np.uint8)), "16-bit image of one channel"),
    "colour": (lambda path: write(path, texture().astype(np.uint16)), "16-bit image of one channel"),
    "8-bit colour": (lambda path: write(path, texture()), "16-bit image of one channel"),
    "all unknown": (lambda path: write(path, np.zeros(SIZE[::-1], np.uint16)), "unknown (0) at every pixel"),
    "no bytes": (lambda path: path.write_bytes(b""), "not an image"),
    "no pixels": (lambda path: path.write_bytes(png(0, 0)), "not an image"),
    "no lines": (lambda path: path.write_bytes(png(64, 48, rows=bytes(129 * 5))), "not an image"),
    "huge": (lambda path: path.write_bytes(png(2000000, 2000000)), "not an image"),
    "text": (lambda path: path.write_text("depth"), "not an image"),
    "missing": (os.remove, "no such file"),
    "cut off": (cut, "cut short"),
}


@pytest.mark.parametrize("kind", BAD_DEPTHS)
def test_depth(planes, kind):
    spoil, complaint = BAD_DEPTHS[kind]
    spoil(planes.depth_file)
    for arguments in (planes.with_depth, ["--registered-depth", planes.depth_file, "--optics", "24,4,0.019"]):
        planes.refused(complaint, *arguments)
    planes.refused_by_segment_depth(complaint)


def test_depth_in_other_formats_that_is_cut_off(planes):
    for name in ("d.tiff", "d.pgm"):
        path = write(planes.folder / name, planes.depth)
        cut(path)
        planes.refused_by_segment_depth("not an image", depth=path)
    planes.refused_by_segment_depth("not a file", depth=planes.folder)


def test_depth_of_another_size_than_calibrated(planes):
    write(planes.depth_file, planes.depth[:-1])
    planes.refused("64x47", *planes.with_depth)


def test_label_map(planes):
    path = planes.folder / "map.png"
    for image in (texture(), texture().astype(np.uint16)):
        write(path, image)
        planes.refused("a label map must be", "--label-map", path)
    write(path, planes.left.astype(np.uint8))
    cut(path)
    planes.refused("cut short", "--label-map", path)
    planes.refused("no such file", "--label-map", planes.folder / "none.png")
    write(planes.folder / "map.tiff", planes.left.astype(np.float32))
    planes.refused("a label map must be", "--label-map", planes.folder / "map.tiff")


# --- rig --------------------------------------------------------------------------------------------------------------

RIG_FILES = ["depth.yaml", "color.yaml", "extrinsics.yaml", "optics.yaml"]


def change(path, key, value):
    content = yaml.safe_load(path.read_text())
    at = content
    for part in key[:-1]:
        at = at[part]
    if value is None:
        del at[key[-1]]
    else:
        at[key[-1]] = value
    path.write_text(yaml.safe_dump(content))


def test_rig_folder_is_missing(planes):
    shutil.rmtree(planes.rig)
    planes.refused("no such rig folder", *planes.with_depth)


@pytest.mark.parametrize("name", RIG_FILES)
def test_rig_file_is_missing_or_no_yaml(planes, name):
    path = planes.rig / name
    for text in ("[1, 2", "just words", "", "\x00\x01", "a: b: c"):
        path.write_text(text)
        planes.refused(f"{name}: ", *planes.with_depth)
    path.unlink()
    planes.refused(f"{name}: no such file", *planes.with_depth)


@pytest.mark.parametrize("name, key", [
    ("depth.yaml", ["image_width"]), ("color.yaml", ["image_height"]), ("color.yaml", ["camera_matrix"]),
    ("depth.yaml", ["camera_matrix", "data"]), ("extrinsics.yaml", ["rotation"]), ("extrinsics.yaml", ["translation"]),
    ("optics.yaml", ["focal_length_mm"]), ("optics.yaml", ["aperture"]), ("optics.yaml", ["circle_of_confusion_mm"])])
def test_rig_key_is_missing_or_of_another_kind(planes, name, key):
    change(planes.rig / name, key, {"no": "number"})
    planes.refused(f"{name}: key '{key[-1]}'" if key != ["camera_matrix"] else name, *planes.with_depth)
    change(planes.rig / name, key, None)
    planes.refused(f"{name}: key '{key[-1]}' is missing", *planes.with_depth)


@pytest.mark.parametrize("name, key, value, complaint", [
    ("color.yaml", ["camera_matrix", "data", 0], 0.0, "fx = 0"),
    ("depth.yaml", ["camera_matrix", "data", 4], 0.0, "fy"),
    ("color.yaml", ["camera_matrix", "data", 0], float("nan"), "fx"), ("color.yaml", ["image_width"], 0, "0"),
    ("color.yaml", ["camera_matrix", "data", 2], float("inf"), "principal point"),
    ("color.yaml", ["image_height"], -48, "-48"),
    ("depth.yaml", ["camera_matrix", "data", 0], -60.0, "fx = -60"),
    ("depth.yaml", ["image_width"], 64.5, "image_width"),
    ("depth.yaml", ["distortion_coefficients", "data", 1], float("nan"), "depth.yaml"),
    ("depth.yaml", ["distortion_coefficients", "data"], [0.0] * 9, "distortion_coefficients"),
    ("depth.yaml", ["distortion_model"], "equidistant", "not supported"),
    ("depth.yaml", ["camera_matrix", "data"], [60.0] * 8, "needs 9 numbers"),
    ("extrinsics.yaml", ["rotation"], [0, 0, 0, 0], "quaternion"),
    ("extrinsics.yaml", ["rotation"], [0, 0, 1], "4 numbers"),
    ("extrinsics.yaml", ["rotation"], [1, 0, 0, 0, 1, 0, 0, 0, 1], "x, y, z, w, not 9 numbers"),
    ("extrinsics.yaml", ["translation"], [52, 0, 0], "depth.png: no depth falls into the colour picture"),
    ("extrinsics.yaml", ["rotation"], [0, 0, 0, float("nan")], "quaternion"),
    ("extrinsics.yaml", ["translation"], [0, 0, float("nan")], "translation"),
    ("extrinsics.yaml", ["translation"], [0, "near", 0], "wrong type"),
    ("optics.yaml", ["focal_length_mm"], 0.0, "focal length"), ("optics.yaml", ["aperture"], float("nan"), "aperture"),
    ("optics.yaml", ["circle_of_confusion_mm"], -0.019, "circle of confusion"), ("optics.yaml", ["aperture"], 1e-200, "aperture"),
    ("optics.yaml", ["circle_of_confusion_mm"], 1e-200, "circle of confusion"),
    ("optics.yaml", ["focal_length_mm"], 1000.0, "not smaller than the nearest depth")])
def test_rig_values(planes, name, key, value, complaint):
    change(planes.rig / name, key, value)
    planes.refused(complaint, *planes.with_depth)


# --- possible, and most likely a mistake ------------------------------------------------------------------------------

def warnings_of(planes, *arguments):
    """What fuse_stack warns of, as on stderr; the report notes the same."""
    report = planes.output("report.json")
    done = succeeded(fuse_stack("--stack", planes.stack, "--output", planes.output("new.png"), "--report", report,
                                *arguments))
    start = "fuse_stack: warning: "
    said = [line[len(start):] for line in done.stderr.splitlines() if line.startswith(start)]
    assert [note for note in read_report(report)["notes"] if note in said] == said
    return said


def test_a_good_rig_gives_no_warning(planes):
    assert warnings_of(planes, *planes.with_depth) == []


@pytest.mark.parametrize("key, value, warning", [
    ("translation", [0, 0, -2.5], "the depth camera stands 2.5 m from the colour camera, rotated by 0 degrees: are "
                                  "these mm?"),
    ("rotation", [0, 0, 1, 0], "rotated by 180 degrees: is it between the optical frames (Z forward, Y down)"),
    ("translation", [1.5, 0, 0], "% of the colour picture gets a depth: check the transform and both calibrations")])
def test_pose_that_is_most_likely_a_mistake(planes, key, value, warning):
    change(planes.rig / "extrinsics.yaml", [key], value)
    said = warnings_of(planes, *planes.with_depth)
    assert len(said) == 1 and warning in said[0], said


def test_circle_of_confusion_in_another_unit(planes):
    said = warnings_of(planes, *planes.with_depth, "--optics", "24,4,2")
    assert len(said) == 1 and said[0].startswith("the circle of confusion, 2 mm, is over a fiftieth of the sensor")


@pytest.mark.parametrize("registered", [False, True])
@pytest.mark.parametrize("turn, warnings", [(1, 0), (-1, 1)])
def test_mirrored_depth(tmp_path, registered, turn, warnings):
    planes = TwoPlanes(tmp_path)
    set_up_boards(planes, turn)
    said = warnings_of(planes, "--registered-depth" if registered else "--depth", planes.depth_file, "--rig", planes.rig)
    assert [line.endswith("when it is mirrored: turn off mirroring where the depth comes from")
            for line in said] == [True] * warnings, said


def test_depth_in_metres(planes):
    write(planes.depth_file, (planes.depth // 1000).astype(np.uint16))
    said = warnings_of(planes, *planes.with_depth, "--optics", "0.5,4,0.001")
    assert len(said) == 1 and said[0].startswith("half of the depths are 1 or less: m"), said
