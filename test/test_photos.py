# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""fuse_stack on photographs as cameras write them: orientation, metadata, colour profile, and what it says at the end."""
import json
import struct

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms

from all_in_focus.files.rig import Camera, Rig, save_rig
from all_in_focus.files.stack import Stack
from tool_helpers import (OPTICS, SIZE, TwoPlanes, expect_refusal, fuse_stack, read, run_tool, segment_depth, succeeded,
                          unchanged)

MAKE, ORIENTATION, ARTIST, PHOTO, TIME = 0x10f, 0x112, 0x13b, 0x8769, 0x9003
# How a camera stores a picture that is to be shown upright, by EXIF orientation.
STORED = {1: lambda image: image, 3: lambda image: image[::-1, ::-1], 6: lambda image: np.rot90(image),
          8: lambda image: np.rot90(image, -1), 2: lambda image: image[:, ::-1], 5: lambda image: image.transpose(1, 0, 2)}


@pytest.fixture
def planes(tmp_path):
    return TwoPlanes(tmp_path / "planes")


def as_camera(planes, orientations, ending="jpg"):
    """Writes the frames of `planes` as a camera does that is held so."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for path in planes.stack.iterdir():
        path.unlink()
    for index, (frame, orientation) in enumerate(zip(planes.frames, orientations)):
        exif = Image.Exif()
        exif[MAKE], exif[ORIENTATION], exif[ARTIST] = "NIKON", orientation, "a person"
        exif[PHOTO] = {TIME: f"2026:05:01 12:00:{index:02d}"}
        stored = np.ascontiguousarray(STORED[orientation](frame)[..., ::-1])
        options = {"quality": 100, "subsampling": 0} if ending == "jpg" else {}
        Image.fromarray(stored).save(planes.stack / f"DSC_{index:04d}.{ending}", exif=exif, icc_profile=profile, **options)
    return profile


def near(one, other):
    return one.shape == other.shape and cv2.PSNR(one, other) > 35


@pytest.mark.parametrize("orientation", sorted(STORED))
def test_the_result_stands_upright(planes, orientation):
    as_camera(planes, [orientation] * 3)
    succeeded(fuse_stack(planes.stack, "--output", planes.output("fused.png"), "--mode", "refined", "--reference", "1"))
    upright = read(planes.output("fused.png"))
    as_camera(planes, [1] * 3)
    succeeded(fuse_stack(planes.stack, "--output", planes.output("plain.png"), "--reference", "1"))
    assert near(upright, read(planes.output("plain.png")))
    assert Image.open(planes.output("fused.png")).getexif().get(ORIENTATION, 1) == 1


def test_a_camera_that_looks_down_tells_orientations_at_random(planes):
    as_camera(planes, [1, 3, 1])
    for index, frame in ((1, planes.frames[1]),):  # the pixels are as those of the others
        path = planes.stack / f"DSC_{index:04d}.jpg"
        exif = Image.open(path).getexif()
        Image.fromarray(np.ascontiguousarray(frame[..., ::-1])).save(path, exif=exif, quality=100, subsampling=0)
    done = succeeded(fuse_stack(planes.stack, "--output", planes.output("fused.png")))
    assert "the EXIF orientation differs from frame to frame" in done.stderr
    assert "3 of 3 frames" in done.stderr


def turned_video(path, frames, degrees):
    """A video whose container says that it is to be turned clockwise."""
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30, frames[0].shape[1::-1])
    for frame in frames:
        video.write(frame)
    video.release()
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 44  # the matrix, in fixed point
    cosine, sine = {90: (0, 1), 180: (-1, 0), 270: (0, -1)}[degrees]
    data[at:at + 36] = struct.pack(">9i", *(part << 16 for part in (cosine, sine, 0, -sine, cosine, 0, 0, 0)), 1 << 30)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_video_stands_upright(planes, degrees):
    shown = [cv2.resize(frame, None, fx=4, fy=4) for frame in planes.frames]
    truth = cv2.resize(planes.truth, None, fx=4, fy=4)
    stored = [np.ascontiguousarray(np.rot90(frame, degrees // 90)) for frame in shown]
    video = turned_video(planes.folder / "sweep.mp4", stored, degrees)
    succeeded(fuse_stack(video, "--output", planes.output("fused.png")))
    fused = read(planes.output("fused.png"))
    assert fused.shape == truth.shape and cv2.PSNR(fused, truth) > cv2.PSNR(fused[::-1, ::-1], truth) + 3
    assert next(iter(Stack(video))).shape == stored[0].shape  # nodes and bags take it as it is stored


@pytest.mark.parametrize("size, turned", [(SIZE, True), (SIZE[::-1], False)])
def test_the_calibration_says_how_the_sensor_lies(planes, size, turned):
    """The pictures are stored on their side, 48x64; the calibration is of upright ones, or of the sensor."""
    as_camera(planes, [6] * 3)
    camera = Camera.pinhole("camera", *size, 60.0, 60.0, size[0] / 2, size[1] / 2)
    save_rig(str(planes.rig), Rig(camera, camera, np.eye(3), [0.0, 0.0, 0.0], OPTICS, "color", "depth"))
    depth = planes.depth if turned else np.ascontiguousarray(np.rot90(planes.depth))
    cv2.imwrite(str(planes.depth_file), depth)
    done = succeeded(fuse_stack(planes.stack, *planes.with_depth, "--output", planes.output("fused.png")))
    assert ("they are, as the calibration has them" in done.stderr) == turned
    assert ("as they are stored" in done.stderr) != turned
    result = Image.open(planes.output("fused.png"))
    assert result.size == size and result.getexif().get(ORIENTATION, 1) == (1 if turned else 6)


@pytest.mark.parametrize("ending", ["jpg", "png", "tif"])
def test_metadata_of_the_reference_go_into_the_result(planes, ending):
    profile = as_camera(planes, [1] * 3)
    output = planes.output(f"fused.{ending}")
    succeeded(fuse_stack(planes.stack, "--output", output, "--reference", "2"))
    with Image.open(output) as result:
        exif = result.getexif()
        assert (exif[MAKE], exif[ARTIST]) == ("NIKON", "a person")
        assert exif.get_ifd(PHOTO)[TIME] == "2026:05:01 12:00:02"
        assert result.info["icc_profile"] == profile
        result.load()
    assert b"DSC_0000.jpg, DSC_0001.jpg, DSC_0002.jpg" in output.read_bytes()


@pytest.mark.parametrize("mode, space", [("CMYK", b"CMYK"), ("L", b"GRAY"), ("RGB", b"junk")])
@pytest.mark.parametrize("ending", ["jpg", "tif"])
def test_a_profile_of_other_colors_is_not_copied(planes, mode, space, ending):
    for path in sorted(planes.stack.iterdir()):
        Image.open(path).convert(mode).save(path.with_suffix("." + ending), icc_profile=bytes(16) + space + bytes(108))
        path.unlink()
    for name in ("sharp.png", "sharp.tif", "sharp.jpg"):
        succeeded(fuse_stack(planes.stack, "--output", planes.output(name)))
        assert "icc_profile" not in Image.open(planes.output(name)).info, name


def test_quality_and_full_resolution_of_colour(planes):
    sizes = []
    for quality in ("30", "95"):
        output = planes.output(f"{quality}.jpg")
        succeeded(fuse_stack(planes.stack, "--output", output, "--quality", quality))
        sizes.append(output.stat().st_size)
        with Image.open(output) as result:
            assert [layer[1:3] for layer in result.layer] == [(1, 1)] * 3  # 4:4:4
    assert sizes[0] < sizes[1]
    succeeded(fuse_stack(planes.stack, "--output", planes.output("default.jpg")))
    assert read(planes.output("default.jpg")).tobytes() == read(planes.output("95.jpg")).tobytes()
    for bad in ("0", "101"):
        with unchanged(planes.folder):
            expect_refusal(fuse_stack(planes.stack, "--output", planes.output("x.jpg"), "--quality", bad), "fuse_stack",
                           "--quality must be from 1 to 100")


def test_a_small_result_for_a_quick_look(planes):
    succeeded(fuse_stack(planes.stack, "--output", planes.output("small.png"), "--width", "32", "--save-source-index",
                         planes.output("index.png")))
    assert read(planes.output("small.png")).shape == (24, 32, 3)
    assert read(planes.output("index.png")).shape == (48, 64)
    succeeded(fuse_stack(planes.stack, "--output", planes.output("same.png"), "--width", "5000"))
    assert read(planes.output("same.png")).shape == (48, 64, 3)


def test_the_last_line_says_what_was_done(planes):
    done = succeeded(fuse_stack(planes.stack, "--output", planes.output("fused.png")))
    assert done.stdout == "" and done.stderr.count("\n") == 1
    assert f"fuse_stack: wrote {planes.output('fused.png')}: 3 of 3 frames, reference 01.png, " in done.stderr
    (planes.stack / "00.png").unlink()
    (planes.stack / "02.png").unlink()
    done = succeeded(fuse_stack(planes.stack, "--output", planes.output("fused.png")))
    assert "of one frame, there was nothing to fuse" in done.stderr


def test_version_and_short_help():
    for tool in (fuse_stack, segment_depth):
        assert " of all_in_focus " in succeeded(tool("--version")).stdout
        assert "--version" in succeeded(tool("-h")).stdout


def test_results_in_formats_without_exif_can_be_read(planes):
    for ending in ("webp", "bmp", "ppm"):
        succeeded(fuse_stack(planes.stack, "--output", planes.output(f"fused.{ending}")))
        with Image.open(planes.output(f"fused.{ending}")) as image:
            image.load()
        assert planes.output(f"fused.{ending}.all_in_focus").is_file()
    done = run_tool("fuse_stack", planes.stack, "--output", planes.output("x.png"), "--report", "/dev/stdout")
    assert not json.loads(done.stdout)["notes"]
