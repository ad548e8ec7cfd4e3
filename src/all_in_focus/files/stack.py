# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A focus stack on disk: a folder of images, or a video; with the focus distances, if known."""
import contextlib
import io
import json
import math
import os
import struct
import sys
import threading
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from all_in_focus import installed
from all_in_focus.files import yaml_file
from all_in_focus.files.focus_table import FocusTable
from all_in_focus.files.input_file import require_regular

Image.MAX_IMAGE_PIXELS = None  # OpenCV has a limit of its own
INVALID_DEPTH = 65535  # mm; what sensors write besides 0 where they have measured nothing
TIFF_ORIENTATION = 274  # tag
COLOR = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
ALL_BITS = COLOR | cv2.IMREAD_ANYDEPTH
TIFF_SUFFIXES = (".tif", ".tiff")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".ppm", ".webp")


class StackError(ValueError):
    """A stack that cannot be read; the message is one line and names the file."""


class Stack:
    """Frames of one focus bracket, of a folder, a video or a TIFF of several pages; read one at a time, so that memory does
    not grow with their number.

    len(stack): number of frames. Iterating gives BGR images of one size, each time from the beginning; 8 bit, or, with
    deep, 16 where the files have them.
    names: of files and pages ("a.tif, page 2"), None for a video; files: paths; distances: focus distances in m, NaN = unknown;
    warnings: lines to show.
    """

    def __init__(self, path, focus=None, deep=False):
        self.path = Path(path)
        self._deep = deep
        listing = _listing(path)
        self.names, self.warnings, self._count = listing["frames"] or None, listing["notes"], listing["count"]
        if self.names and self._count == 1 and self.path.is_file():
            raise StackError(f"{self.path}: a single image: give its folder, or a video")
        self._pages = list(zip(listing["frames"], listing["paths"], listing["pages"]))
        self.files = [Path(path) for path in dict.fromkeys(listing["paths"])]
        self.distances = load_focus(focus, self.names, self._count, listing["left_out"]) if focus else [math.nan] * self._count

    def __len__(self):
        return self._count

    def __iter__(self):
        size = None
        for name, frame in self._frames():
            if size is None:
                size = frame.shape
            elif frame.shape != size:
                raise StackError(f"{name}: {size_text(frame)} pixels, but the first frame has {size[1]}x{size[0]}")
            yield frame

    def _frames(self):
        if self.names is not None:
            for name, path, page_at in self._pages:
                yield Path(path).parent / name, read_color(path, self._deep, page_at)
            return
        video = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG)
        if hasattr(cv2, "CAP_PROP_ORIENTATION_AUTO"):
            video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # as stored, like pictures: the calibration is of the sensor
        for index in range(self._count):  # one after the other: seeking by frame number is not reliable
            good, frame = video.read()
            if not good:
                raise StackError(f"{self.path}: frame {index} cannot be read")
            yield f"{self.path}: frame {index}", frame


def _listing(path):
    """Frames in their order, or how many a video has: one program knows the rule for those in C++ and in Python."""
    try:
        return json.loads(installed.run([installed.find("list_stack"), "--stack", str(path)]))
    except RuntimeError as error:
        raise StackError(str(error).replace("list_stack: ", "", 1))


def read_pages(path):
    """[(name, BGR image), ...] of a picture file: one, or the pages of a TIFF. As read_color() gives them, deep."""
    if Path(path).suffix.lower() not in TIFF_SUFFIXES:
        return [(Path(path).name, read_color(path, True))]
    listing = _listing(path)
    return [(name, read_color(path, True, at)) for name, at in zip(listing["frames"], listing["pages"])]


def is_image_name(name):
    """Whether a file in a folder counts as a picture; hidden ones do not."""
    return name.lower().endswith(IMAGE_SUFFIXES) and not name.startswith(".")


def size_text(image):
    return f"{image.shape[1]}x{image.shape[0]}"


def read_image(path, flags=COLOR, page_at=0):
    """Image as OpenCV decodes it; BGR, 8 bit by default. StackError, also for truncated files, which OpenCV pads. page_at: see
    decode_image()."""
    try:
        require_regular(path)
        data = Path(path).read_bytes()
    except OSError as error:
        raise StackError(f"{path}: {error.strerror}")
    if not is_complete(data):
        raise StackError(f"{path}: truncated or damaged")
    image = decode_image(data, flags, page_at)
    if image is None:
        raise StackError(f"{path}: not a readable image")
    return image


def read_color(path, deep, page_at=0):
    """BGR image: 8 bit, or, with deep, 16 where the file has them. StackError, also for what has other numbers. page_at: see
    decode_image()."""
    image = read_image(path, ALL_BITS, page_at)
    if image.dtype not in (np.uint8, np.uint16):
        raise StackError(f"{path}: has {image.dtype} pixels, which only fuse_stack reads: save it with 8 or 16 bits")
    return image if deep else eight_bits(image)


def eight_bits(image):
    """The upper 8 bits of an image of 8 or 16."""
    return image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)


def decode_image(data, flags=COLOR, page_at=0):
    """Image as OpenCV decodes it; None where the bytes are no image. page_at: where the directory of a TIFF's page begins, 0:
    the first page."""
    try:
        with _silent_libraries():
            return cv2.imdecode(np.frombuffer(_tiff_as_stored(data, page_at), np.uint8), flags) if data else None
    except cv2.error:  # the header announces an impossible size
        return None


def _tiff_as_stored(data, page_at):
    """OpenCV reads the first page of a TIFF and turns it as it says, whatever the flags are: the wanted page becomes the first,
    and is made to say "not at all"."""
    order = {b"II": "<", b"MM": ">"}.get(data[:2])
    if not order:
        return data
    try:
        big = {42: False, 43: True}[struct.unpack_from(order + "H", data, 2)[0]]
        first = order + ("Q" if big else "I"), 8 if big else 4
        at = page_at or struct.unpack_from(first[0], data, first[1])[0]
        count_format, entry_bytes, to_value = (order + "Q", 20, 12) if big else (order + "H", 12, 8)
        begin = at + struct.calcsize(count_format)
        entries = range(begin, min(begin + struct.unpack_from(count_format, data, at)[0] * entry_bytes, len(data)), entry_bytes)
        changed = bytearray(data)
        struct.pack_into(first[0], changed, first[1], at)
        for entry in entries:
            if struct.unpack_from(order + "H", data, entry)[0] == TIFF_ORIENTATION:
                struct.pack_into(order + "H", changed, entry + to_value, 1)
        return bytes(changed)
    except (KeyError, struct.error):  # no TIFF, or a damaged one
        return data


@contextlib.contextmanager
def _silent_libraries():
    """Discards what libpng and libjpeg print to stderr beside our errors; not where other threads may write there."""
    if threading.active_count() > 1:
        yield
        return
    sys.stderr.flush()
    saved, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(nowhere)


def read_depth(path, camera=None):
    """Depth image in mm (16 bit, one channel), 0 = unknown; so is INVALID_DEPTH. camera: of depth.yaml, whose size it must
    have."""
    image = read_image(path, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise StackError(f"{path}: expected a 16-bit image with one channel (depth in mm)")
    if camera and image.shape != (camera.height, camera.width):
        raise StackError(f"{path}: {size_text(image)} pixels, but depth.yaml says {camera.width}x{camera.height}")
    image[image == INVALID_DEPTH] = 0
    return image


def is_complete(data):
    """Whether a PNG or JPEG file is whole and undamaged; other bytes count as complete, OpenCV judges them."""
    if not data.startswith((b"\x89PNG", b"\xff\xd8")):
        return True
    if data.startswith(b"\xff\xd8") and b"\xff\xd9" not in data[data.rfind(b"\xff\xda"):]:
        return False  # no end mark behind the pixels: the decoder takes zeros in their place for pixels
    try:
        with Image.open(io.BytesIO(data)) as image:
            if image.format == "PNG":
                image.verify()  # the checksums
            else:
                image.draft(image.mode, (1, 1))  # decodes at an eighth of the size: quick, but reads all of the data
                image.load()
    except (OSError, SyntaxError, ValueError, EOFError, struct.error):
        return False
    return True


def focus_of_arrivals(path):
    """Function of (name, index in its bracket) that returns the focus distance of a picture in m, NaN = unknown."""
    table, entries = _focus_file(path)
    by_name = dict(entries)
    return lambda name, index: table.distance(index) if table else by_name.get(name, math.nan)


def _focus_file(path):
    """(FocusTable or None, entries: (name or None, metres or NaN), in order) of a file that has a focus_table, or
    `frames: [{file: 00.png, focus_mm: 855.0}, ...]`."""
    data = yaml_file.read(path, StackError)
    table = FocusTable.of(data, path)
    if table:
        return table, []
    entries = data.get("frames") if isinstance(data, dict) else None
    if not isinstance(entries, list):
        raise StackError(f"{path}: expected frames: [{{file: 00.png, focus_mm: 855.0}}, ...]")
    yaml_file.require_keys(data, ("frames",), path)
    found = []
    for number, entry in enumerate(entries):
        where = f"{path}: entry {number}"
        yaml_file.require_keys(entry, ("file", "focus_mm"), where)
        value = math.nan if entry.get("focus_mm", "") is None else entry.get("focus_mm", "")  # null is unknown
        if type(value) not in (int, float) or value <= 0:
            raise StackError(f"{where}: focus_mm: expected a positive number, not '{value}'")
        found.append((entry.get("file"), value / 1000.0))
    return None, found


def load_focus(path, names, frames, left_out=()):
    """Focus distances of a stack in m, NaN = unknown; see _focus_file().

    names: file names of the stack, None for a video: its entries are in frame order and name no file. Entries for names in
    left_out, pictures that are no frames, count for nothing."""
    table, entries = _focus_file(path)
    if table:
        return [table.distance(index) for index in range(frames)]
    if names is None:
        if len(entries) > frames:
            raise StackError(f"{path}: {len(entries)} entries for {frames} frames")
        return [distance for _, distance in entries] + [math.nan] * (frames - len(entries))
    found = {}
    for number, (name, distance) in enumerate(entries):
        name = Path(str(name)).name  # stack/00.png is 00.png
        if name in left_out:
            continue
        if name not in names:
            raise StackError(f"{path}: entry {number}: no frame is named '{name}'")
        if name in found:
            raise StackError(f"{path}: entry {number}: '{name}' is listed twice")
        found[name] = distance
    return [found.get(name, math.nan) for name in names]


def save_focus(path, names, distances_mm):
    yaml_file.write(path, {"frames": [{"file": name, "focus_mm": float(distance)}
                                      for name, distance in zip(names, distances_mm)]})
