# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bad stacks, focus files and output paths of fuse_stack: exit code 2, one line that says why, nothing written."""
import os

import cv2
import pytest

from file_helpers import cut, file_limit, hide_cut, pictures, write_video
from tool_helpers import TwoPlanes, expect_refusal, fuse_stack, segment_depth, succeeded, texture, unchanged, write


@pytest.fixture
def planes(tmp_path):
    planes = TwoPlanes(tmp_path / "planes")
    planes.output("old.png").write_text("an earlier result")
    return planes


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
    write(planes.stack / "02.png", planes.truth[:, :-1])
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
    planes.refused("no such folder or video", stack="/dev/null")


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
    ("frames: [{file: 00.png, focus_mm: 23}]", "not beyond the focal length"),
    ("frames: [{file: 00.png, focus_mm: 24.0}]", "not beyond the focal length"),
    ("frames: [{file: 00.png, focus_mm: 0}]", "positive"), ("frames: [{file: 00.png, focus_mm: -900}]", "positive"),
    ("frames: [{file: 00.png, focus_mm: near}]", "wrong type"), ("frames: [{file: 09.png, focus_mm: 900}]", "09.png"),
    ("frames: [{file: 00.png, focus_mm: 900}, {file: 00.png, focus_mm: 950}]", "twice"),
    ("frames: [{focus_mm: 900}]", "'file' is missing"), ("frames: [{file: 00.png}]", "'focus_mm' is missing"),
    ("frames: [900]", "missing"), ("frames: 900", "must be a list"), ("frames:", "list"), ("[", "not YAML"),
    ("focus: []", "'frames' is missing"), ("", "keys")])
def test_focus(planes, text, complaint):
    focus = planes.folder / "focus.yaml"
    focus.write_text(text)
    planes.refused(complaint, *planes.with_depth, "--focus", focus)
    planes.refused("none.yaml: no such file", *planes.with_depth, "--focus", planes.folder / "none.yaml")


def test_focus_of_a_video(planes):
    video = write_video(planes.folder / "v.avi", pictures(2, (64, 48)))
    focus = planes.folder / "focus.yaml"
    focus.write_text("frames: [{focus_mm: 900}, {focus_mm: 1000}, {focus_mm: 1100}]")
    planes.refused("3 entries for 2 frames", *planes.with_depth, "--focus", focus, stack=video)
    focus.write_text("frames: [{focus_mm: 900}, {focus_mm: 20}]")
    planes.refused("not beyond the focal length", *planes.with_depth, "--focus", focus, stack=video)


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
        planes.refused("cannot be written", *planes.with_depth, prefix=bounded)
    finally:
        (planes.folder / "out").chmod(0o755)


@pytest.mark.parametrize("kb", [0, 1, 4, 8])
@pytest.mark.parametrize("output", ["old.png", "new.jpg", "new.bmp"])
def test_full_disk(planes, kb, output):
    """Stood in for by a limit on the size of files: the picture has 9 kB and more in every format."""
    write(planes.stack / "03.png", cv2.resize(texture(), (128, 96), interpolation=cv2.INTER_NEAREST))
    for name in ("00.png", "01.png", "02.png"):
        (planes.stack / name).unlink()
    planes.refused("cannot be written", output=output, preexec_fn=file_limit(kb), restore_signals=False)
