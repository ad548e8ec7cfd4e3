# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Focus stacks: order, completeness, focus distances."""
import math
import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from all_in_focus.files.stack import Stack, StackError, read_depth, read_image, read_pages
from file_helpers import SIZE, cut, focus_file, hide_cut, pictures, run_script, write_pages, write_stack, write_video


def test_folder_goes_in_name_order_and_skips_what_is_no_image(tmp_path):
    frames = pictures(3)
    folder = write_stack(tmp_path / "stack", ["b.png", "a.png", "C.PNG"], frames)
    (tmp_path / "stack" / "notes.txt").write_text("x")
    (tmp_path / "stack" / "deeper").mkdir()
    stack = Stack(folder)
    assert stack.names == ["a.png", "b.png", "C.PNG"] and not stack.warnings
    for read, expected in zip(stack, [frames[1], frames[0], frames[2]]):
        assert np.array_equal(read, expected)
    assert all(math.isnan(d) for d in stack.distances)


@pytest.mark.parametrize("names", [
    ["2.png", "10.png"], ["02.png", "3.png", "010.png"], ["a2b.png", "a10b.png"], ["img (1).png", "img (2).png", "img (10).png"],
    ["1_focus.png", "2_focus.png", "10_focus.png"], ["z-20.png", "z-03.png", "z+00.png", "z+15.png"],
    ["z-20.png", "z-3.png", "z0.png", "z15.png"], ["IMG-2.png", "IMG-10.png"], ["2026-01-02 9.png", "2026-01-02 10.png"],
    ["DSC_9998.JPG", "DSC_9999.JPG", "DSC_0001.JPG", "DSC_0002.JPG"], ["a1.png", "B2.png", "c1.png"],
    ["7.png", "20260101123000.png", "99999999999999999999999999.png"]])
def test_order_is_that_of_the_numbers(tmp_path, names):
    assert Stack(write_stack(tmp_path / "stack", names[::-1])).names == names


def with_exif_times(folder, times):
    """A JPEG of each name, taken at that second."""
    folder.mkdir()
    for name, second in times.items():
        exif = Image.Exif()
        exif[0x8769] = {0x9003: f"2026:05:01 12:00:{int(second):02d}", 0x9291: f"{second % 1:.2f}"[2:]}
        Image.fromarray(pictures(1)[0]).save(folder / name, exif=exif)
    return folder


def tiff(order, big, orientation):
    """A gray row of three pixels; order: of the bytes; big: BigTIFF."""
    head, count, offset = (16, "Q", "Q") if big else (8, "H", "I")
    tags = {256: 3, 257: 1, 258: 8, 259: 1, 262: 1, 273: head, 274: orientation, 277: 1, 278: 1, 279: 3}
    mark = {"<": b"II", ">": b"MM"}[order] + struct.pack(order + "H", 43 if big else 42)
    entries = b"".join(struct.pack(order + "HH" + offset, tag, 3, 1) + struct.pack(order + "H", value).ljust(
        struct.calcsize(offset), b"\0") for tag, value in tags.items())
    return (mark + (struct.pack(order + "HH", 8, 0) if big else b"") + struct.pack(order + offset, head + 4)
            + bytes([10, 20, 30, 0]) + struct.pack(order + count, len(tags)) + entries + bytes(8))


def test_times_that_disagree_with_names_are_said(tmp_path):
    stack = Stack(with_exif_times(tmp_path / "same", {"1.jpg": 1, "2.jpg": 1.5, "10.jpg": 2}))
    assert stack.names == ["1.jpg", "2.jpg", "10.jpg"] and not stack.warnings
    stack = Stack(with_exif_times(tmp_path / "other", {"1.jpg": 1, "2.jpg": 1.7, "3.jpg": 1.2}))
    assert stack.names == ["1.jpg", "2.jpg", "3.jpg"]
    assert "2.jpg was taken after 3.jpg; the order is that of the names" in stack.warnings[0]
    # A time decides between names of equal numbers, and against a counter that has not begun anew.
    assert Stack(with_exif_times(tmp_path / "tie", {"01.jpg": 2, "1.jpg": 1})).names == ["1.jpg", "01.jpg"]
    gap = {"0001.jpg": 1, "0002.jpg": 2, "9998.jpg": 3, "9999.jpg": 4}
    assert Stack(with_exif_times(tmp_path / "gap", gap)).names == list(gap)


def test_pages_of_a_tiff_are_frames(tmp_path):
    """In one file and in those of a folder; each as it is stored, thumbnails left out."""
    frames = pictures(4)
    folder = tmp_path / "stack"
    folder.mkdir()
    write_pages(folder / "a.tif", frames[:1], tiffinfo={274: 6})
    write_pages(folder / "b.tif", [*frames[1:], frames[0][:8, :8]], tiffinfo={274: 6})
    stack = Stack(folder)
    assert stack.names == ["a.tif", "b.tif, page 1", "b.tif, page 2", "b.tif, page 3"]
    assert stack.files == [folder / "a.tif", folder / "b.tif"] and "b.tif has 3 pages" in " ".join(stack.warnings)
    assert np.array_equal(list(stack), frames)
    alone = Stack(folder / "b.tif", focus_file(tmp_path, "frames: [{file: 'b.tif, page 2', focus_mm: 1500}]"))
    assert np.array_equal(list(alone), frames[1:]) and alone.distances[1] == 1.5
    with pytest.raises(StackError, match="a.tif: a single image"):
        Stack(folder / "a.tif")
    (folder / "damaged.tif").write_bytes(b"II*\0")
    with pytest.raises(StackError, match="damaged.tif: not a readable image"):
        read_pages(folder / "damaged.tif")


def test_names_that_are_not_utf8_are_refused(tmp_path):
    path = Path(os.fsdecode(bytes(tmp_path) + b"/\xff.avi"))
    write_video(tmp_path / "v.avi", pictures(3)).rename(path)
    with pytest.raises(StackError, match=r"\.avi: a file or folder has a name that is not UTF-8"):
        Stack(path)


def test_pages_keep_sixteen_bits(tmp_path):
    codes = np.arange(48 * 32, dtype=np.uint16).reshape(32, 48) * 40
    first, second = Stack(write_pages(tmp_path / "deep.tif", [codes, codes[::-1]]), deep=True)
    assert np.array_equal(first[..., 0], codes) and np.array_equal(second[..., 2], codes[::-1])


def test_pictures_that_cannot_be_read_are_named(tmp_path):
    folder = write_stack(tmp_path / "stack", ["1.png", "2.png"])
    (folder / "3.NEF").write_bytes(b"raw")
    (folder / "4.heic").write_bytes(b"phone")
    (folder / "5.png").symlink_to(tmp_path / "nowhere.png")
    stack = Stack(folder)
    assert stack.names == ["1.png", "2.png"] and len(stack.warnings) == 3
    for part in ("3.NEF: camera raw files cannot be read", "4.heic: pictures of this format", "5.png: no file is there"):
        assert any(part in warning for warning in stack.warnings)


def test_pictures_that_stand_there_twice_are_named(tmp_path):
    stack = Stack(write_stack(tmp_path / "stack", ["1.jpg", "1.tif", "2.jpg", "2.tif", "3.jpg"]))
    assert len(stack.names) == 5 and [warning.split(": ")[1:] for warning in stack.warnings] == [
        ["1.tif, 2.tif", "the same name has another ending, too, and both are frames", "keep one of each shot"]]


def test_alpha_gray_and_16_bit_are_read_as_8_bit_color(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((4, 5, 4), 77, np.uint8))
    cv2.imwrite(str(tmp_path / "b.png"), np.full((4, 5), 77 * 257, np.uint16))
    cv2.imwrite(str(tmp_path / "c.png"), np.full((4, 5), 77, np.uint8))
    for frame in Stack(str(tmp_path)):
        assert frame.dtype == np.uint8 and frame.shape == (4, 5, 3) and (frame == 77).all()


def test_floats_are_refused(tmp_path):
    """By programs that do not scale them: their codes 0 to 1 would be black."""
    cv2.imwrite(str(tmp_path / "a.tif"), np.full((4, 5, 3), 0.7, np.float32))
    for deep in (False, True):
        with pytest.raises(StackError, match="a.tif: has float32 pixels"):
            list(Stack(str(tmp_path), deep=deep))


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("big", [False, True])
def test_a_tiff_is_read_as_it_is_stored(tmp_path, order, big):
    """OpenCV turns it whatever it is told."""
    path = tmp_path / "a.tif"
    for orientation in range(1, 9):
        path.write_bytes(tiff(order, big, orientation))
        assert read_image(path)[..., 0].tolist() == [[10, 20, 30]], orientation
        assert read_image(path, cv2.IMREAD_UNCHANGED).tolist() == [[10, 20, 30]], orientation


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_truncated_image_is_refused(tmp_path, ending):
    folder = write_stack(tmp_path / "stack", [f"0{ending}", f"1{ending}"])
    cut(folder / f"1{ending}")
    with pytest.raises(StackError, match=f"1{ending}: truncated"):
        list(Stack(folder))


def test_damaged_png_and_jpeg_with_thumbnail(tmp_path):
    path = str(tmp_path / "a.png")
    cv2.imwrite(path, pictures(1)[0])
    data = bytearray(open(path, "rb").read())
    data[len(data) // 2] ^= 1
    open(path, "wb").write(data)
    with pytest.raises(StackError, match="damaged"):
        read_image(path)
    # A thumbnail has an end marker of its own, in a segment before the image data; cameras append data after the end.
    good, jpeg = cv2.imencode(".jpg", pictures(1)[0])
    jpeg = jpeg.tobytes()
    thumbnail = b"\xff\xe1" + (2 + len(jpeg)).to_bytes(2, "big") + jpeg
    path = str(tmp_path / "b.jpg")
    for body, complete in ((jpeg[2:], True), (jpeg[2:-200], False), (jpeg[2:] + b"camera data", True)):
        open(path, "wb").write(b"\xff\xd8" + thumbnail + body)
        if complete:
            assert read_image(path).shape == (SIZE[1], SIZE[0], 3)
        else:
            with pytest.raises(StackError, match="truncated"):
                read_image(path)


def test_libraries_print_nothing_beside_our_errors(tmp_path):
    """An undamaged file, as its checksums go, whose compressed data make no sense."""
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), pictures(1)[0])
    data = path.read_bytes()
    at = data.index(b"IDAT")
    length = int.from_bytes(data[at - 4:at], "big")
    chunk = b"IDAT" + b"nonsense" * (length // 8) + b"x" * (length % 8)
    path.write_bytes(data[:at] + chunk + zlib.crc32(chunk).to_bytes(4, "big") + data[at + 8 + length:])
    done = run_script("contact_sheet", "--output", tmp_path / "sheet.png", path)
    assert (done.returncode, done.stderr) == (2, f"contact_sheet: {path}: not a readable image\n")


def test_bad_stacks_are_named(tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    (tmp_path / "text.avi").write_text("no video")
    (tmp_path / "zero.png").write_bytes(b"")
    sizes = write_stack(tmp_path / "sizes", ["0.png", "1.png"], pictures(1) + pictures(1, (20, 10)))
    for path, complaint in ((tmp_path / "none", "no such"), (empty, "no image"),
                            (tmp_path / "text.avi", "not a video that can be read"), (sizes, "1.png: 20x10"),
                            (sizes / "0.png", "single image")):
        with pytest.raises(StackError, match=complaint) as error:
            list(Stack(path))
        assert str(path) in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(StackError, match="not a readable image"):
        read_image(tmp_path / "zero.png")
    with pytest.raises(StackError, match="16-bit"):
        read_depth(sizes / "0.png")


def test_video_is_counted_by_decoding_and_read_repeatedly(tmp_path):
    path = write_video(tmp_path / "v.avi", pictures(7))
    stack = Stack(path)
    assert len(stack) == 7 and stack.names is None
    first, second = list(stack), list(stack)
    assert len(first) == 7 and all(np.array_equal(a, b) for a, b in zip(first, second))


def test_truncated_video_is_refused(tmp_path):
    path = write_video(tmp_path / "v.avi", pictures(50))
    cut(path)
    with pytest.raises(StackError, match="cut short"):
        Stack(path)
    hide_cut(path)
    with pytest.raises(StackError, match="of 50 frames|not a video that can be read|holds no frame"):
        Stack(path)


def test_focus_of_a_folder_goes_by_name(tmp_path):
    folder = write_stack(tmp_path / "stack", ["0.png", "1.png", "2.png"])
    focus = focus_file(tmp_path, "frames: [{file: 2.png, focus_mm: .inf}, {file: 0.png, focus_mm: 855.0}]")
    distances = Stack(folder, focus).distances
    assert distances[0] == 0.855 and math.isnan(distances[1]) and distances[2] == math.inf


def test_focus_of_a_video_goes_in_frame_order(tmp_path):
    video = write_video(tmp_path / "v.avi", pictures(4))
    focus = focus_file(tmp_path, "frames:\n- {focus_mm: 1000}\n- {focus_mm: null}\n- {focus_mm: .nan}\n")
    distances = Stack(video, focus).distances
    assert distances[0] == 1.0 and all(math.isnan(d) for d in distances[1:])


@pytest.mark.parametrize("text, complaint", [
    ("frames: [{file: 9.png, focus_mm: 1}]", "9.png"), ("frames: 3", "expected frames"), ("[", "not valid YAML"),
    ("frames: [{file: 0.png, focus_mm: -1}]", "positive"), ("frames: [{file: 0.png, focus_mm: near}]", "positive"),
    ("frames: [{file: 0.png, focus_mm: 800,314}]", "a number ends with ',314': write a decimal point"),
    ("focus_table: [{step: 0, mm: 500,5}, {step: 9, mm: 900}]", "ends with ',5'"),
    ("frames: [{file: 0.png, focus_mm: 800,5e1}]", "ends with ',5e1'"),
    ("frames: [{file: 0.png}]", "entry 0: focus_mm: expected a positive number, not ''"),
    ("frames: [{file: 0.png, focus_mn: 800}]", "entry 0: 'focus_mn' is none of the keys file, focus_mm"),
    ("frames: [{file: 0.png, focus_mm: 800, 314: x}]", "entry 0: '314' is none of the keys file, focus_mm"),
    ("{frames: [], step: 2}", "'step' is none of the keys frames"),
    ("{focus_table: [{step: 0, mm: 500}, {step: 9, mm: 900}], setp: 2}", "'setp' is none of the keys focus_table, first, step"),
    ("focus_table: [{step: 0, mm: 500}, {step: 9, mm: 900, x: 1}]", "focus_table: entry 1: 'x' is none of the keys step, mm"),
    ("frames: [{file: 0.png, focus_mm: yes}]", "positive"), ("frames: [7]", "entry 0: '7' is none of the keys file, focus_mm"),
    ("frames: [{file: 0.png, focus_mm: 1}, {file: 0.png, focus_mm: 2}]", "twice"), ("", "expected frames")])
def test_bad_focus_files_are_refused(tmp_path, text, complaint):
    folder = write_stack(tmp_path / "stack", ["0.png"])
    with pytest.raises(ValueError, match=complaint) as error:
        Stack(folder, focus_file(tmp_path, text))
    assert "focus.yaml" in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(StackError, match="No such file"):
        Stack(folder, str(tmp_path / "none.yaml"))


def test_focus_of_a_video_with_too_many_entries(tmp_path):
    video = write_video(tmp_path / "v.avi", pictures(1))
    with pytest.raises(StackError, match="2 entries for 1 frames"):
        Stack(video, focus_file(tmp_path, "frames: [{focus_mm: 1}, {focus_mm: 2}]"))
