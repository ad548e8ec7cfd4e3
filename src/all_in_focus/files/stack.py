# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A focus stack on disk: a folder of images in name order, or a video; with the focus distances, if known."""
import math
import os
import re
import zlib

import cv2
import numpy as np

from all_in_focus.files import yaml_file

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".ppm", ".webp")


class StackError(ValueError):
    """A stack that cannot be read; the message is one line and names the file."""


class Stack:
    """Frames of one focus bracket, read one at a time: memory does not grow with their number.

    len(stack): frames; iterating: BGR images, 8 bit, all of one size; may be done repeatedly.
    names: file names, None for a video. distances: focus distances in m, NaN = unknown.
    warnings: one line each, for the caller to show.
    """

    def __init__(self, path, focus=None):
        self.path = path
        self.warnings = []
        if not os.path.exists(path):
            raise StackError("%s: no such folder or video" % path)
        self.names = self._list() if os.path.isdir(path) else None
        self._count = len(self.names) if self.names is not None else self._count_video()
        self.distances = load_focus(focus, self.names, self._count) if focus else [math.nan] * self._count

    def __len__(self):
        return self._count

    def __iter__(self):
        size = None
        for name, frame in self._frames():
            if size is None:
                size = frame.shape
            elif frame.shape != size:
                raise StackError("%s: %dx%d pixels, but the first frame has %dx%d"
                                 % (name, frame.shape[1], frame.shape[0], size[1], size[0]))
            yield frame

    def _list(self):
        names = sorted(name for name in os.listdir(self.path)
                       if is_image_name(name) and os.path.isfile(os.path.join(self.path, name)))
        if not names:
            raise StackError("%s: holds no images" % self.path)
        for first, second in zip(names, names[1:]):
            if _natural(first) > _natural(second):
                self.warnings.append("%s: frames go in plain name order, %s comes before %s: pad the numbers with zeros"
                                     % (self.path, first, second))
                break
        return names

    def _count_video(self):
        """Number of frames, by decoding: the number in the header is an estimate."""
        if self.path.lower().endswith(IMAGE_SUFFIXES):
            raise StackError("%s: is a single image; give its folder or a video" % self.path)
        _check_riff(self.path)
        video = self._open_video()
        announced = video.get(cv2.CAP_PROP_FRAME_COUNT)
        found = 0
        while video.grab():
            found += 1
        if found == 0:
            raise StackError("%s: holds no readable frame" % self.path)
        # Headers are commonly off by one; more is missing only in files that were cut off.
        if math.isfinite(announced) and announced - found > max(1, 0.01 * announced):
            raise StackError("%s: truncated: %d of %d frames can be read" % (self.path, found, announced))
        return found

    def _open_video(self):
        video = cv2.VideoCapture(self.path, cv2.CAP_FFMPEG)
        if not video.isOpened():
            raise StackError("%s: not a readable video" % self.path)
        return video

    def _frames(self):
        if self.names is not None:
            for name in self.names:
                path = os.path.join(self.path, name)
                yield path, read_image(path)
            return
        video = self._open_video()
        for index in range(self._count):  # in sequence: seeking by frame number is not reliable
            good, frame = video.read()
            if not good:
                raise StackError("%s: frame %d cannot be read" % (self.path, index))
            yield "%s: frame %d" % (self.path, index), frame


def is_image_name(name):
    """Whether a file in a folder counts as a picture; hidden ones do not."""
    return name.lower().endswith(IMAGE_SUFFIXES) and not name.startswith(".")


def _natural(name):
    """Sort key that reads digits as numbers."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", name)]


def read_image(path, flags=cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION):
    """Image as OpenCV gives it; BGR, 8 bit by default. Raises StackError, also on cut-off files, which OpenCV pads."""
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as error:
        raise StackError("%s: %s" % (path, error.strerror))
    if not _is_complete(data):
        raise StackError("%s: truncated or damaged" % path)
    image = decode_image(data, flags)
    if image is None:
        raise StackError("%s: not a readable image" % path)
    return image


def decode_image(data, flags=cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION):
    """Image as OpenCV gives it, None where the bytes are none."""
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error:  # a header that tells an impossible size
        return None


def read_depth(path):
    """Depth image in mm (16 bit, one channel), 0 = unknown."""
    image = read_image(path, cv2.IMREAD_UNCHANGED)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise StackError("%s: expected a 16-bit image with one channel (depth in mm)" % path)
    return image


def _is_complete(data):
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return _png_is_complete(data)
    if data.startswith(b"\xff\xd8"):
        return _jpeg_is_complete(data)
    return True


def _png_is_complete(data):
    """Whether the chunks up to IEND are there and what the image needs of them is undamaged."""
    at = 8
    while at + 12 <= len(data):
        length = int.from_bytes(data[at:at + 4], "big")
        name, end = data[at + 4:at + 8], at + 8 + length
        critical = name[:1].isupper()
        if critical and zlib.crc32(data[at + 4:end]) != int.from_bytes(data[end:end + 4], "big"):
            return False
        if name == b"IEND":
            return True
        at = end + 4
    return False


def _jpeg_is_complete(data):
    """Whether the end marker follows the image data; segments before it (thumbnails) have end markers of their own."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        if data[at + 1] == 0xFF:  # padding
            at += 1
        elif data[at + 1] == 0xDA:  # image data begins
            return data.find(b"\xff\xd9", at) >= 0
        else:
            at += 2 + int.from_bytes(data[at + 2:at + 4], "big")
    return False


def _check_riff(path):
    """An AVI says how long it is: a cut-off copy is shorter."""
    with open(path, "rb") as file:
        head = file.read(12)
    if head[:4] == b"RIFF" and int.from_bytes(head[4:8], "little") + 8 > os.path.getsize(path):
        raise StackError("%s: truncated: %d bytes of %d"
                         % (path, os.path.getsize(path), int.from_bytes(head[4:8], "little") + 8))


def focus_entries(path):
    """(name or None, metres or NaN), in order, from `frames: [{file: 00.png, focus_mm: 855.0}, ...]`."""
    data = yaml_file.read(path, StackError)
    entries = data.get("frames") if isinstance(data, dict) else None
    if not isinstance(entries, list):
        raise StackError("%s: expected frames: [{file: 00.png, focus_mm: 855.0}, ...]" % path)
    found = []
    for number, entry in enumerate(entries):
        where = "%s: entry %d" % (path, number)
        if not isinstance(entry, dict):
            raise StackError("%s: expected {file: NAME, focus_mm: NUMBER}" % where)
        found.append((entry.get("file"), _metres(entry.get("focus_mm"), where)))
    return found


def load_focus(path, names, frames):
    """Focus distances of a stack in m, NaN = unknown; see focus_entries().

    names: file names of the stack, None for a video: its entries go in frame order and name no file.
    """
    entries = focus_entries(path)
    if names is None and len(entries) > frames:
        raise StackError("%s: %d entries for %d frames" % (path, len(entries), frames))
    distances = [math.nan] * frames
    listed = set()
    for number, (name, distance) in enumerate(entries):
        index = number
        if names is not None:
            where = "%s: entry %d" % (path, number)
            if name not in names:
                raise StackError("%s: no frame is named '%s'" % (where, name))
            if name in listed:
                raise StackError("%s: '%s' is listed twice" % (where, name))
            listed.add(name)
            index = names.index(name)
        distances[index] = distance
    return distances


def _metres(value, where):
    if value is None:
        return math.nan
    if type(value) not in (int, float) or value <= 0:
        raise StackError("%s: focus_mm: expected a positive number, not '%s'" % (where, value))
    return value / 1000.0
