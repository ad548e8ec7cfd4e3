# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""fuse_stack on frames that are not 8-bit colour: 16 bits, fewer bits in 16, float, pages, transparency, raw files."""
import shutil
import struct
import subprocess

import cv2
import numpy as np
import pytest

from file_helpers import write_pages
from tool_helpers import TwoPlanes, expect_refusal, fuse_stack, read, succeeded, unchanged

# Colour filter array, black and white level, white balance and colour matrix of the raw files below.
CFA_WHITE, NEUTRAL = 4095, (0.5, 1.0, 0.7)


@pytest.fixture
def planes(tmp_path):
    return TwoPlanes(tmp_path / "planes")


def put(planes, frames, ending="png", write=None):
    """Other frames in the place of those of `planes`."""
    for path in planes.stack.iterdir():
        path.unlink()
    for index, frame in enumerate(frames):
        path = planes.stack / f"{index:02d}.{ending}"
        if write:
            write(path, frame)
        else:
            assert cv2.imwrite(str(path), frame)


def fused(planes, *options, stack=None, name="fused.png"):
    done = succeeded(fuse_stack(stack or planes.stack, "--output", planes.output(name), "--reference", "1", *options))
    return read(planes.output(name)), done.stderr


def psnr(image, truth, white=255):
    error = image.astype(float) - truth
    return 10 * np.log10(white ** 2 / max(np.mean(error ** 2), 1e-9))


def scaled(frame, white, dtype=np.uint16):
    codes = frame.astype(float) * white / 255
    return (np.rint(codes) if dtype == np.uint16 else codes).astype(dtype)


@pytest.mark.parametrize("white", [1023, 4095, 16383, 65535])
def test_codes_of_fewer_bits_are_scaled(planes, white):
    plain, _ = fused(planes)
    put(planes, [scaled(frame, white) for frame in planes.frames])
    result, said = fused(planes)
    assert result.dtype == np.uint16
    assert psnr(result / 257, plain) > 45
    assert (f"scaled so that {white} is white" in said) == (white < 65535)


def test_gray_frames_of_ten_bits(planes):
    gray = [cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) for frame in planes.frames]
    put(planes, gray)
    plain, _ = fused(planes)
    put(planes, [scaled(frame, 1023) for frame in gray])
    assert psnr(fused(planes)[0] / 257, plain) > 45


def write_gray(path, codes, bits, *tags):
    """A TIFF of 16 bits, or of 12 that are packed; tags: beside those that every TIFF has."""
    height, width = codes.shape
    data = codes.astype("<u2").tobytes()
    if bits == 12:
        even, odd = codes[:, ::2], codes[:, 1::2]
        data = np.dstack([even >> 4, (even & 15) << 4 | odd >> 8, odd & 255]).astype(np.uint8).tobytes()
    write_tiff(path, sorted([(256, "I", [width]), (257, "I", [height]), (258, "H", [bits]), (259, "H", [1]), (262, "H", [1]),
                             (273, "I", [0]), (277, "H", [1]), (278, "I", [height]), (279, "I", [len(data)]), *tags]), data)


@pytest.mark.parametrize("bits, tags", [(16, [(281, "H", [4095])]), (16, [(341, "H", [4095])]), (12, [])])
def test_a_tiff_names_its_highest_code(planes, bits, tags):
    """No code of these dark frames tells how many bits the camera has."""
    gray = [cv2.cvtColor(frame // 10, cv2.COLOR_BGR2GRAY) for frame in planes.frames]
    put(planes, [scaled(frame, 65535) for frame in gray])
    for path, frame in zip(sorted(planes.stack.iterdir()), gray):
        cv2.imwrite(str(path), np.where(np.indices(frame.shape).sum(axis=0) == 0, 65535, scaled(frame, 65535)))
    bright, _ = fused(planes)
    put(planes, [scaled(frame, 4095) for frame in gray], "tif", lambda path, codes: write_gray(path, codes, bits, *tags))
    result, said = fused(planes)
    assert psnr(result[1:, 1:] / 257, bright[1:, 1:] / 257) > 50
    assert ("scaled so that 4095 is white" in said) == (bits == 16)


@pytest.mark.parametrize("bright", [(1, 1, 4), (4, 1, 1), (1, 4, 1)])
def test_all_frames_are_scaled_alike(planes, bright):
    """A dark frame that has no high code does not count as one of fewer bits."""
    frames = [scaled(frame // 5, 4095) for frame in planes.frames]
    for frame, factor in zip(frames, bright):
        if factor > 1:
            frame[0, 0] = 4095
    put(planes, frames)
    assert "scaled so that 4095 is white" in fused(planes)[1]


@pytest.mark.parametrize("ending", ["pgm", "ppm"])
def test_pnm_files_name_their_highest_code(planes, ending):
    gray = [cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) // 8 for frame in planes.frames]

    def write(path, frame):
        channels = 1 if ending == "pgm" else 3
        codes = np.repeat(scaled(frame, 4095)[..., None], channels, axis=2).astype(">u2")
        path.write_bytes(b"P%d\n# a camera\n%d %d\n4095\n" % (5 if channels == 1 else 6, *frame.shape[::-1]) + codes.tobytes())

    put(planes, gray)
    plain, _ = fused(planes)
    put(planes, gray, ending, write)
    assert psnr(fused(planes)[0] / 257, plain) > 45


@pytest.mark.parametrize("white", [1, 255, 65535])
def test_float_tiff(planes, white):
    plain, _ = fused(planes)
    put(planes, [scaled(frame, white, np.float32) for frame in planes.frames], "tif")
    result, _ = fused(planes)
    assert result.dtype == np.uint16 and psnr(result / 257, plain) > 45


def test_float_of_another_range_is_refused(planes):
    put(planes, [scaled(frame, 1e7, np.float32) for frame in planes.frames], "tif")
    planes.refused("none of 0..1, 0..255 and 0..65535")


def test_float_that_is_no_number_is_black(planes):
    frames = [scaled(frame, 1, np.float32) for frame in planes.frames]
    for frame in frames:
        frame[5, 5] = np.nan
    put(planes, frames, "tif")
    assert fused(planes)[0].max() > 40000


def ramp(planes):
    """Frames with a smooth ramp of 16 bits above the texture."""
    height, width, _ = planes.truth.shape
    slope = np.linspace(20000, 21500, width)[None, :, None] + np.linspace(0, 23, height // 2)[:, None, None] * np.ones(3)
    frames = [scaled(frame, 65535).astype(float) for frame in planes.frames]
    truth = scaled(planes.truth, 65535).astype(float)
    for frame in [*frames, truth]:
        frame[:height // 2] = slope
    return [np.rint(frame).astype(np.uint16) for frame in frames], truth


@pytest.mark.parametrize("ending", ["png", "tif"])
@pytest.mark.parametrize("mode", ["refined", "paper"])
def test_sixteen_bits_in_and_out(planes, ending, mode):
    frames, truth = ramp(planes)
    put(planes, frames, ending)
    result, _ = fused(planes, "--mode", mode, name=f"fused.{ending}")
    assert result.dtype == np.uint16
    sky = result[:truth.shape[0] // 2 - 6].astype(int)
    assert np.abs(sky - truth[:len(sky)]).max() <= 2 and len(np.unique(sky)) > 256
    assert np.abs(np.diff(sky, axis=1)).max() < 2 * 1500 / truth.shape[1]  # 257 where 8 bits cut it


def test_sixteen_bits_gain(planes):
    frames, truth = ramp(planes)
    put(planes, frames)
    deep = psnr(fused(planes)[0], truth, 65535)
    put(planes, [np.rint(frame / 257).astype(np.uint8) for frame in frames])
    assert deep > psnr(fused(planes)[0] * 257.0, truth, 65535) + 0.1


def test_sixteen_bits_where_frames_are_warped_and_brightened(planes):
    frames = [scaled(frame, 50000) for frame in planes.frames]
    frames[2] = np.roll(frames[2], 2, axis=1) // 5 * 4
    put(planes, frames)
    deep, _ = fused(planes)
    put(planes, [np.rint(frame / 257).astype(np.uint8) for frame in frames])
    assert psnr(deep / 257, fused(planes)[0]) > 38


def test_sixteen_bits_in_mode_restored(planes):
    distances = "frames:\n" + "".join(f"- {{file: {i:02d}.png, focus_mm: {mm}}}\n" for i, mm in enumerate((500, 1000, 3000)))
    (planes.folder / "focus.yaml").write_text(distances)
    options = [*planes.with_depth, "--focus", planes.folder / "focus.yaml", "--mode", "restored"]
    plain, _ = fused(planes, *options)
    put(planes, [scaled(frame, 65535) for frame in planes.frames])
    deep, _ = fused(planes, *options)
    assert deep.dtype == np.uint16 and psnr(deep / 257, plain) > 45


@pytest.mark.parametrize("depth, wide, result", [("8", True, np.uint8), ("16", False, np.uint16), ("16", True, np.uint16),
                                                 ("auto", False, np.uint8), ("auto", True, np.uint16)])
def test_depth_of_output(planes, depth, wide, result):
    plain, _ = fused(planes)
    if wide:
        put(planes, [scaled(frame, 65535) for frame in planes.frames])
    image, _ = fused(planes, "--depth-of-output", depth)
    assert image.dtype == result
    assert psnr(image / (257 if result == np.uint16 else 1), plain) > 45


def test_formats_of_eight_bits(planes):
    put(planes, [scaled(frame, 65535) for frame in planes.frames])
    image, said = fused(planes, name="fused.jpg")
    assert image.dtype == np.uint8 and "holds 8 of the 16 bits" in said
    planes.refused("16-bit values do not fit", "--depth-of-output", "16", output="fused.jpg")
    planes.refused("none of 8, 16 and auto", "--depth-of-output", "12")


@pytest.mark.parametrize("compression", [None, "tiff_lzw"])
def test_pages_of_a_tiff_are_frames(planes, compression):
    plain, _ = fused(planes)
    path = write_pages(planes.folder / "stack.tif", planes.frames, compression=compression)
    result, said = fused(planes, stack=path)
    assert np.array_equal(result, plain) and "3 of 3 frames, reference stack.tif, page 2" in said


@pytest.mark.parametrize("kept", [0.4, 0.7, 0.9, 0.99])
def test_pages_that_are_cut_off(planes, kept):
    path = write_pages(planes.folder / "stack.tif", planes.frames)
    path.write_bytes(path.read_bytes()[:int(kept * path.stat().st_size)])
    with unchanged(planes.folder):
        expect_refusal(fuse_stack(path, "--output", planes.output("x.png")), "fuse_stack", "stack.tif")


def test_pages_in_a_folder(planes):
    plain, _ = fused(planes)
    put(planes, [])
    write_pages(planes.stack / "a.tif", planes.frames[:2])
    write_pages(planes.stack / "b.tif", planes.frames[2:])
    result, said = fused(planes)
    assert np.array_equal(result, plain) and "a.tif has 2 pages: each is a frame" in said


def test_aligned_frames_and_clouds_of_sixteen_bits(planes):
    put(planes, [scaled(frame, 65535) for frame in planes.frames])
    fused(planes, *planes.with_depth, "--save-aligned", planes.output("aligned"), "--save-cloud", planes.output("o.ply"))
    aligned = [read(path) for path in sorted(planes.output("aligned").iterdir())]
    assert [frame.dtype for frame in aligned] == 3 * [np.uint16]
    assert all(psnr(frame / 257, plain) > 45 for frame, plain in zip(aligned, planes.frames))
    assert planes.output("o.ply").stat().st_size > planes.truth.size


def test_pages_are_split_into_brackets(planes):
    plain, _ = fused(planes)
    path = write_pages(planes.folder / "two.tif", planes.frames + planes.frames)
    succeeded(fuse_stack(path, "--split", "3", "--output", planes.output("parts"), "--reference", "1"))
    parts = sorted(planes.output("parts").iterdir())
    assert [part.name for part in parts] == ["two_01.png", "two_02.png"]
    assert all(np.array_equal(read(part), plain) for part in parts)


def test_a_single_page_is_a_single_picture(planes):
    path = write_pages(planes.folder / "one.tif", planes.frames[:1])
    with unchanged(planes.folder):
        expect_refusal(fuse_stack(path, "--output", planes.output("x.png")), "fuse_stack", "a single image")


def pre_aligned(depth, height=120, width=160):
    """Frames of one picture with borders without content, and the picture. Each border is shown by two of three frames."""
    random = np.random.default_rng(3)
    coarse = cv2.resize(random.uniform(60, 180, (height // 15, width // 16, 3)), (width, height), interpolation=cv2.INTER_CUBIC)
    truth = np.clip(coarse + random.uniform(0, 60, (height, width, 3)), 0, 255)
    white = 255 if depth == np.uint8 else 65535
    frames = []
    for empty in (np.s_[:6], np.s_[:, :5], np.s_[-7:]):
        frame = np.dstack([np.rint(truth * white / 255), np.full((height, width), white)]).astype(depth)
        frame[empty] = 0
        frames.append(frame)
    return frames, truth


@pytest.mark.parametrize("ending, depth", [("png", np.uint8), ("tif", np.uint8), ("png", np.uint16), ("webp", np.uint8)])
@pytest.mark.parametrize("mode", ["refined", "paper"])
def test_transparent_pixels_weigh_nothing(planes, ending, depth, mode):
    options = [cv2.IMWRITE_WEBP_QUALITY, 101] if ending == "webp" else []
    frames, truth = pre_aligned(depth)
    put(planes, frames, ending, lambda path, frame: cv2.imwrite(str(path), frame, options))
    result, said = fused(planes, "--mode", mode)
    assert result.dtype == depth and "3 of 3 frames" in said
    assert psnr(result / (257 if depth == np.uint16 else 1), truth) > 40


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_black_borders_of_aligned_frames_weigh_nothing(planes, depth):
    """Without alpha. Borders that are black in all frames stay black."""
    frames, truth = pre_aligned(depth)
    for frame in frames:
        frame[:, -4:] = 0
    put(planes, [frame[..., :3] for frame in frames])
    result, said = fused(planes)
    result = result / (257 if depth == np.uint16 else 1)
    assert "3 of 3 frames" in said and psnr(result[:, :-5], truth[:, :-5]) > 40 and not result[:, -4:].any()


@pytest.mark.parametrize("ending", ["jp2", "pgm", "ppm", "bmp", "webp", "tif"])
def test_every_format_is_read(planes, ending):
    frames = [cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) for frame in planes.frames] if ending == "pgm" else planes.frames
    if ending == "jp2":  # keeps little of noise
        frames = [cv2.GaussianBlur(frame, (0, 0), 1.5) for frame in frames]
    put(planes, frames, ending)
    result, said = fused(planes)
    put(planes, [read(path) for path in sorted(planes.stack.iterdir())])  # some formats lose pixels
    assert np.array_equal(result, fused(planes)[0]) and "3 of 3 frames" in said


def write_dng(path, frame):
    """A raw file as a camera with 12 bits writes it: a Bayer pattern of linear light."""
    light = np.where(frame <= 10, frame / 3294.6, ((frame / 255 + 0.055) / 1.055) ** 2.4)[..., ::-1] * NEUTRAL  # RGB
    bayer = np.empty(frame.shape[:2])
    for (y, x), channel in {(0, 0): 0, (0, 1): 1, (1, 0): 1, (1, 1): 2}.items():
        bayer[y::2, x::2] = light[y::2, x::2, channel]
    data = np.rint(bayer * CFA_WHITE).astype("<u2").tobytes()
    height, width = bayer.shape
    matrix = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])  # sRGB of XYZ
    matrix = np.diag(NEUTRAL) @ matrix
    tags = [(254, "I", [0]), (256, "I", [width]), (257, "I", [height]), (258, "H", [16]), (259, "H", [1]),
            (262, "H", [32803]), (271, "s", b"Make\0"), (272, "s", b"Model\0"), (273, "I", [0]), (274, "H", [1]), (277, "H", [1]),
            (278, "I", [height]), (279, "I", [len(data)]), (33421, "H", [2, 2]), (33422, "B", [0, 1, 1, 2]),
            (50706, "B", [1, 4, 0, 0]), (50707, "B", [1, 1, 0, 0]), (50708, "s", b"Make Model\0"), (50717, "I", [CFA_WHITE]),
            (50721, "r", [(round(1e4 * value), 10000) for value in matrix.flat]),
            (50728, "R", [(round(1e4 * value), 10000) for value in NEUTRAL]), (50778, "H", [21])]
    write_tiff(path, tags, data)


def write_tiff(path, tags, data):
    """data: the one strip, which tag 273 is made to name."""
    at = 8 + 2 + 12 * len(tags) + 4
    entries, values = b"", b""
    for tag, kind, value in tags:
        if kind == "s":
            packed, count, number = value, len(value), 2
        elif kind in "rR":
            packed = b"".join(struct.pack("<ii" if kind == "r" else "<II", *pair) for pair in value)
            count, number = len(value), 10 if kind == "r" else 5
        else:
            packed, count, number = struct.pack(f"<{len(value)}{kind}", *value), len(value), {"B": 1, "H": 3, "I": 4}[kind]
        if tag == 273:
            strip = len(entries) + 8
            packed = b"\0\0\0\0"
        if len(packed) > 4:
            entries += struct.pack("<HHII", tag, number, count, at + len(values))
            values += packed + b"\0" * (len(packed) % 2)
        else:
            entries += struct.pack("<HHI", tag, number, count) + packed.ljust(4, b"\0")
    entries = entries[:strip] + struct.pack("<I", at + len(values)) + entries[strip + 4:]
    path.write_bytes(b"II*\0" + struct.pack("<I", 8) + struct.pack("<H", len(tags)) + entries + b"\0" * 4 + values + data)


def reads_raw(planes):
    return "build with LibRaw" not in fuse_stack(planes.stack, "--output", planes.output("x.png")).stderr


def test_raw_files_are_developed(planes):
    frames = [cv2.GaussianBlur(frame, (0, 0), 1.5) for frame in planes.frames]  # a Bayer pattern can show
    put(planes, frames)
    plain, _ = fused(planes)
    put(planes, frames, "dng", write_dng)
    if not reads_raw(planes):
        pytest.skip("built without LibRaw")
    result, said = fused(planes)
    assert result.dtype == np.uint16 and "3 of 3 frames, reference 01.dng" in said
    assert psnr(result / 257, plain) > 25


def test_of_a_raw_file_and_its_picture_one_is_read(planes):
    frames = [cv2.GaussianBlur(frame, (0, 0), 1.5) for frame in planes.frames]
    put(planes, frames)
    for index, frame in enumerate(frames):
        write_dng(planes.stack / f"{index:02d}.dng", frame)
    _, said = fused(planes)
    assert "3 of 3 frames" in said
    if "build with LibRaw" in said:
        return
    assert "left out 00.png, 01.png, 02.png: the camera raw files of the same shots are read" in said
    (planes.stack / "01.dng").unlink()
    _, said = fused(planes)
    assert "3 of 3 frames, reference 01.png" in said and "left out 00.dng, 02.dng" in said


def test_broken_raw_files(planes):
    put(planes, [b"II*\0 no raw file"] * 3, "dng", lambda path, data: path.write_bytes(data))
    done = fuse_stack(planes.stack, "--output", planes.output("x.png"))
    assert done.returncode == 2 and ("dng: not a raw file" in done.stderr or "build with LibRaw" in done.stderr)


@pytest.mark.skipif(not shutil.which("heif-enc"), reason="needs heif-enc")
def test_heic(planes):
    put(planes, [cv2.GaussianBlur(frame, (0, 0), 2) for frame in planes.frames])  # colour has half the resolution
    plain, _ = fused(planes)
    for index in range(3):
        png = planes.stack / f"{index:02d}.png"
        subprocess.run(["heif-enc", "-q", "95", str(png), "-o", str(png.with_suffix(".heic"))], check=True, capture_output=True)
        png.unlink()
    done = fuse_stack(planes.stack, "--output", planes.output("h.png"), "--reference", "1")
    if "this format cannot be read" in done.stderr:
        pytest.skip("built without libheif")
    assert psnr(read(planes.output("h.png")), plain) > 25
