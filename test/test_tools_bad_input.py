# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bad options, files and paths of fuse_stack and segment_depth: exit code 2, one line that says why, nothing written."""
import math
import os
import shutil
import struct
import zlib

import cv2
import numpy as np
import pytest
import yaml

from file_helpers import cut, file_limit, focus_file, hide_cut, pictures, write_video
from tool_helpers import (SIZE, TwoPlanes, expect_refusal, fuse_stack, read_report, run_tool, segment_depth, set_up_boards,
                          succeeded, texture, unchanged, write)

from all_in_focus.files.rig import Camera, load_rig, save_rig


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
    expect_refusal(run_tool("segment_depth", *arguments), "segment_depth", complaint)


@pytest.mark.parametrize("arguments, complaint", [
    (["--sharp"], "unrecognised option '--sharp'"), (["--refer", "1"], "unrecognised option"), (["-x"], "-x"),
    (["spare"], "--output names a folder, not a file, where stacks are several"),
    (["--mode", "best"], "none of paper, refined, restored"),
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

def png(width, height, rows=b""):
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)) +
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


def test_data_behind_the_end_of_a_png_do_no_harm(planes):
    with planes.depth_file.open("ab") as file:
        file.write(bytes(1000))
    succeeded(fuse_stack("--stack", planes.stack, "--output", planes.output("new.png"), *planes.with_depth))


def test_depth_in_other_formats_that_is_cut_off(planes):
    for name in ("d.tiff", "d.pgm"):
        path = write(planes.folder / name, planes.depth)
        cut(path)
        planes.refused_by_segment_depth("not an image", depth=path)
    planes.refused_by_segment_depth("not a file", depth=planes.rig)


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
    ("depth.yaml", ["distortion_model"], "omni", "not supported"),
    ("depth.yaml", ["camera_matrix", "data"], [60.0] * 8, "needs 9 numbers"),
    ("extrinsics.yaml", ["rotation"], [0, 0, 0, 0], "quaternion"),
    ("extrinsics.yaml", ["rotation"], [0, 0, 1], "x, y, z, w, not 3 numbers"),
    ("extrinsics.yaml", ["translation"], [7, 0, 0, 0], "needs 3 numbers, not 4"),
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


# --- stacks -----------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("name, complaint", [
    ("02.png", "02.png: PNG is cut short"), ("02.jpg", "02.jpg: JPEG is cut short"), ("02.bmp", "02.bmp: not an image"),
    ("02.ppm", "02.ppm: not an image"), ("02.tiff", "02.tiff: not an image"), ("02.webp", "02.webp: not an image")])
def test_truncated_image(planes, name, complaint):
    (planes.stack / "02.png").unlink()
    cut(write(planes.stack / name, planes.truth))
    planes.refused(complaint, *planes.with_depth)


@pytest.mark.parametrize("at", [20, -1000])
def test_damaged_image(planes, at):
    data = bytearray((planes.stack / "01.png").read_bytes())
    data[at] ^= 255
    (planes.stack / "01.png").write_bytes(data)
    planes.refused("01.png: not an image", *planes.with_depth)


def test_truncated_jpeg_with_a_thumbnail(planes):
    """The thumbnail has an end mark of its own; cameras append data of theirs after the last."""
    jpeg = cv2.imencode(".jpg", planes.truth)[1].tobytes()
    thumbnail = cv2.imencode(".jpg", planes.truth[:8, :8])[1].tobytes()
    head = b"\xff\xd8\xff\xe1" + (2 + len(thumbnail)).to_bytes(2, "big") + thumbnail
    path = planes.stack / "03.jpg"
    path.write_bytes(head + jpeg[2:] + b"camera data")
    succeeded(fuse_stack("--stack", planes.stack, "--output", planes.folder / "o.png"))
    path.write_bytes(head + jpeg[2:-500])
    planes.refused("03.jpg: JPEG is cut short", *planes.with_depth)


def test_images_of_changing_size(planes):
    """Where none of two sizes is that of most; a single one of another size is left out, see test_separate_files.py."""
    write(planes.stack / "02.png", planes.truth[:, :-1])
    (planes.stack / "00.png").unlink()
    for arguments in (planes.with_depth, []):
        planes.refused("63x48", *arguments)


def test_folder_without_images(planes):
    for path in planes.stack.iterdir():
        path.rename(f"{path!s}.txt")
    planes.refused("holds no image")
    (planes.stack / "folder.png").mkdir()
    planes.refused("holds no image")
    (planes.stack / "none.png").symlink_to("nowhere.png")
    planes.refused("holds no image")
    (planes.stack / "text.png").write_text("no image")
    planes.refused("text.png: not an image")


def test_what_is_neither_folder_nor_video(planes):
    planes.refused("no such folder or video", stack=planes.folder / "none")
    planes.refused("single image", stack=planes.stack / "00.png")
    for name, content in (("v.avi", b"no video"), ("v.mp4", b""), ("v.avi", b"RIFF\x04\0\0\0AVI "),
                          ("v", b"\0" * 5000)):
        (planes.folder / name).write_bytes(content)
        planes.refused("video", stack=planes.folder / name)
    planes.refused("is no regular file", stack="/dev/null")


@pytest.mark.parametrize("arguments", [True, False])
def test_truncated_video(planes, arguments):
    path = write_video(planes.folder / "v.avi", pictures(40))
    arguments = planes.with_depth if arguments else []
    cut(path)
    planes.refused("cut short", *arguments, stack=path)
    hide_cut(path)
    planes.refused("video", *arguments, stack=path)


# --- focus ------------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("text, complaint", [
    ("frames: [{file: 00.png, focus_mm: 900,5}]", "a number ends with ',5': write a decimal point"),
    ("focus_table: [{step: 0, mm: 500,25}, {step: 9, mm: 900}]", "ends with ',25'"),
    ("frames: [{file: 00.png, focus_mm: 800,5e1}]", "ends with ',5e1'"),
    ("frames: [{file: 00.png, focus_mn: 800}]", "entry 0: 'focus_mn' is none of the keys file, focus_mm"),
    ("frames: [{file: 00.png, focus_mm: 800, 314: x}]", "entry 0: '314' is none of the keys file, focus_mm"),
    ("{frames: [], step: 2}", "'step' is none of the keys frames"),
    ("{focus_table: [{step: 0, mm: 500}, {step: 9, mm: 900}], setp: 2}", "'setp' is none of the keys focus_table, first, step"),
    ("focus_table: [{step: 0, mm: 500}, {step: 9, mm: 900, x: 1}]", "focus_table: entry 1: 'x' is none of the keys step, mm"),
    ("focus_table: [{step: 0, mm: 500}]", "focus_table: expected two steps or more"),
    ("focus_table: [{step: 0, mm: 500}, {step: 0, mm: 900}]", "steps must differ"),
    ("focus_table: [{step: 9, mm: 900}, {step: 0, mm: 500}, {step: 12, mm: 700}]", "distances must grow or fall throughout"),
    ("frames: [{file: 00.png, focus_mm: 23}]", "not beyond the focal length"),
    ("frames: [{file: 00.png, focus_mm: 24.0}]", "not beyond the focal length"),
    ("frames: [{file: 00.png, focus_mm: 0}]", "positive"), ("frames: [{file: 00.png, focus_mm: -900}]", "positive"),
    ("frames: [{file: 00.png, focus_mm: near}]", "wrong type"), ("frames: [{file: 09.png, focus_mm: 900}]", "09.png"),
    ("frames: [{file: 00.png, focus_mm: 900}, {file: 00.png, focus_mm: 950}]", "twice"),
    ("frames: [{focus_mm: 900}]", "'file' is missing"), ("frames: [{file: 00.png}]", "'focus_mm' is missing"),
    ("frames: [900]", "missing"), ("frames: 900", "must be a list"), ("frames:", "list"), ("[", "not YAML"),
    ("focus: []", "'frames' is missing"), ("", "keys")])
def test_focus(planes, text, complaint):
    planes.refused(complaint, *planes.with_depth, "--focus", focus_file(planes.folder, text))
    planes.refused("none.yaml: no such file", *planes.with_depth, "--focus", planes.folder / "none.yaml")


def test_focus_of_a_video(planes):
    video = write_video(planes.folder / "v.avi", pictures(2, (64, 48)))
    for entries, complaint in (("{focus_mm: 900}, {focus_mm: 1000}, {focus_mm: 1100}", "3 entries for 2 frames"),
                               ("{focus_mm: 900}, {focus_mm: 20}", "not beyond the focal length")):
        focus = focus_file(planes.folder, f"frames: [{entries}]")
        planes.refused(complaint, *planes.with_depth, "--focus", focus, stack=video)


# --- outputs ----------------------------------------------------------------------------------------------------------

IMAGE_OPTIONS = ["--save-registered", "--save-labels", "--save-source-index", "--save-weights"]


@pytest.mark.parametrize("option", ["--output", "--report", *IMAGE_OPTIONS])
def test_output_folder_is_missing(planes, option):
    paths = {"--output": planes.output("old.png"), "--report": planes.output("new.json")}
    for path, complaint in ((planes.folder / "none" / "x.png", "does not exist"), (planes.folder / "out", "is a folder"),
                            ("", f"{option} is empty")):
        arguments = [part for pair in {**paths, option: path}.items() for part in pair]
        with unchanged(planes.folder):
            expect_refusal(fuse_stack("--stack", planes.stack, *planes.with_depth, *arguments), "fuse_stack", complaint)


@pytest.mark.parametrize("name", ["o.txt", "o", "o.", ".png", "o.png.gz", "o.pbm"])
def test_output_ending(planes, name):
    planes.refused("use .png", *planes.with_depth, output=name)
    planes.refused("use .png", *planes.with_depth, "--save-weights", planes.output(name))


@pytest.mark.parametrize("ending", ["jpg", "bmp", "webp"])
def test_16_bit_outputs_need_a_format_that_holds_them(planes, ending):
    """OpenCV would write 8 bits without a word."""
    for option in IMAGE_OPTIONS[:3]:
        planes.refused("16-bit values do not fit", *planes.with_depth, option, planes.output(f"x.{ending}"))
    planes.refused_by_segment_depth("16-bit values do not fit", output=f"x.{ending}")


def test_one_file_for_two_outputs(planes):
    planes.refused("two outputs", *planes.with_depth, "--save-labels", planes.output("old.png"))
    planes.refused("two outputs", *planes.with_depth, "--save-labels", planes.output("../out/new.png"),
                   "--save-weights", planes.output("new.png"))
    labels = planes.output("l.png")
    with unchanged(planes.folder):
        expect_refusal(segment_depth("--depth", planes.depth_file, "--optics", "24,4,0.019", "--output", labels, "--report",
                                     labels), "segment_depth", "two outputs")


def test_read_only_output_folder(planes):
    # Root may write everywhere unless it gives the right up.
    bounded = ["setpriv", "--bounding-set=-dac_override", "--inh-caps=-dac_override"] if os.getuid() == 0 else []
    (planes.folder / "out").chmod(0o555)
    try:
        planes.refused("cannot be written: Permission denied", *planes.with_depth, prefix=bounded)
    finally:
        (planes.folder / "out").chmod(0o755)


@pytest.mark.parametrize("kb", [0, 1, 4, 8])
@pytest.mark.parametrize("output", ["old.png", "new.jpg", "new.bmp"])
def test_full_disk(planes, kb, output):
    """Stood in for by a limit on the size of files: the picture has 9 kB and more in every format."""
    write(planes.stack / "03.png", cv2.resize(texture(), (128, 96), interpolation=cv2.INTER_NEAREST))
    for name in ("00.png", "01.png", "02.png"):
        (planes.stack / name).unlink()
    planes.refused("cannot be written: File too large", output=output, preexec_fn=file_limit(kb), restore_signals=False)


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
    ("translation", [1.5, 0, 0], "% of the colour picture gets a depth: check the transform and both calibrations")])
def test_pose_that_is_most_likely_a_mistake(planes, key, value, warning):
    change(planes.rig / "extrinsics.yaml", [key], value)
    said = warnings_of(planes, *planes.with_depth)
    assert len(said) == 1 and warning in said[0], said


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_camera_that_is_truly_turned_draws_no_alarm(tmp_path, degrees):
    planes = TwoPlanes(tmp_path)
    set_up_boards(planes)
    picture = cv2.imread(str(planes.depth_file), cv2.IMREAD_UNCHANGED)
    write(planes.depth_file, np.ascontiguousarray(np.rot90(picture, degrees // 90)))  # counter-clockwise
    rig = load_rig(planes.rig)
    size = (480, 640) if degrees != 180 else (640, 480)
    rig.depth = Camera.pinhole("depth", *size, 600.0, 600.0, (size[0] - 1) / 2, (size[1] - 1) / 2)
    rig.quaternion = [0, 0, math.sin(math.radians(degrees / 2)), math.cos(math.radians(degrees / 2))]
    save_rig(planes.rig, rig)
    assert warnings_of(planes, *planes.with_depth) == []


def test_principal_point_of_other_pictures(planes):
    change(planes.rig / "color.yaml", ["camera_matrix", "data"], [60.0, 0, 8, 0, 60, 6, 0, 0, 1])
    said = warnings_of(planes, *planes.with_depth)
    assert said[0].startswith("the principal point of the colour camera, 8, 6, is not in the middle half"), said


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
