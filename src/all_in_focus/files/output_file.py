# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writes files that are complete or not there: beside their place first, then renamed in one step. Pictures get a mark, by
which a later run does not take them for frames of a stack."""
import contextlib
import errno
import json
import os
import shutil
import stat
import struct
import sys
import tempfile
import zlib
from pathlib import Path

from PIL import Image

SOFTWARE = 305  # EXIF
MARK = "all_in_focus"  # its value in a result; the ending of the file beside a result of a format without EXIF


@contextlib.contextmanager
def named(path, working):
    """Re-raises OSErrors about the temporary file or folder `working` with the user's path instead. An OSError that names no
    file, as that of a full disk, gets the user's path, too. If closing the file fails after it without saying why, as LZ4
    does in a bag, the first one is raised."""
    path, working = Path(path), Path(working)
    try:
        yield
    except OSError as last:
        error = last.__context__ if last.errno is None and isinstance(last.__context__, OSError) else last
        place = working if error.filename is None else Path(str(error.filename))
        if error.errno is None or working not in (place, *place.parents):
            raise
        raise OSError(error.errno, error.strerror, str(path / place.relative_to(working))) from None


@contextlib.contextmanager
def whole_file(path):
    """Yields the Path to write to. It replaces `path` at the end, in one step; on an error nothing is left behind. A
    symbolic link stays, and what it names is replaced. Into what is no regular file (a FIFO, /dev/stdout) the content is
    copied."""
    stream = _is_stream(path)
    target = Path(os.path.realpath(path)) if Path(path).is_symlink() and not stream else Path(path)
    folder = Path(tempfile.mkdtemp()) if stream else target.parent
    working = folder / f".{os.getpid()}.{target.name}"  # keeps the suffix, which may choose the format
    try:
        with named(path, working):
            if target.is_file() and not target.stat().st_mode & 0o222:  # replacing it would go around that
                raise PermissionError(errno.EACCES, "is write-protected", str(target))
            yield working
            if stream:
                sys.stdout.flush()
                number = _standard_stream(path)
                with open(working, "rb") as file, open(path if number is None else os.dup(number), "wb") as output:
                    shutil.copyfileobj(file, output)
            else:
                if target.exists():
                    shutil.copymode(target, working)
                os.replace(working, target)
    finally:
        if working.exists():
            working.unlink()
        if stream:
            folder.rmdir()


def _standard_stream(path):
    """The number of this program's stdout or stderr, where that is what the path names, or None."""
    with contextlib.suppress(OSError):
        named_file = Path(path).stat()
        return next((number for number in (1, 2) if os.path.samestat(os.fstat(number), named_file)), None)


def _is_stream(path):
    """Whether the path names something that is written to as it is: no regular file, or what this program's own output goes
    to. OSError for what cannot be written to like a file."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        mode = Path(path).stat().st_mode
        if stat.S_ISBLK(mode) or stat.S_ISSOCK(mode):
            raise OSError(errno.EINVAL, "is a device or socket, not a file to write", str(path))
        return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode) or _standard_stream(path) is not None
    return False


def write_picture(path, image):
    """Writes an image file in the format of its suffix, PNG without one. ValueError for other suffixes."""
    import cv2  # takes most of the time in which a program starts; many write no picture
    try:
        data = cv2.imencode(Path(path).suffix or ".png", image)[1].tobytes()
    except cv2.error:
        raise ValueError(f"{path}: no image format has this ending: use .png") from None
    with whole_file(path) as working:
        working.write_bytes(_marked(data))


def is_result(path):
    """Whether a picture is one that this package has written."""
    with contextlib.suppress(OSError, SyntaxError, ValueError), Image.open(path) as image:
        if str(image.getexif().get(SOFTWARE, "")).startswith(MARK):
            return True
    return Path(f"{path}.{MARK}").exists()


def _marked(data):
    """A PNG or JPEG file with the mark of a result; other data as they are."""
    exif = Image.Exif()
    exif[SOFTWARE] = MARK
    block = exif.tobytes()
    if data.startswith(b"\x89PNG"):
        chunk = b"eXIf" + block[len(b"Exif\0\0"):]  # goes behind the first one, IHDR
        return b"".join([data[:33], struct.pack(">I", len(chunk) - 4), chunk, struct.pack(">I", zlib.crc32(chunk)), data[33:]])
    if data.startswith(b"\xff\xd8"):
        return b"".join([data[:2], b"\xff\xe1", struct.pack(">H", len(block) + 2), block, data[2:]])
    return data


def write_json(path, data):
    """Writes a JSON file; ValueError for NaN and infinity, which JSON does not know."""
    text = json.dumps(data, indent=2, allow_nan=False) + "\n"
    with whole_file(path) as working:
        working.write_text(text, encoding="utf-8")


def encode_png(image):
    """PNG file as bytes; colour images are BGR. ValueError where the type of the image does not fit PNG."""
    import cv2
    try:
        return cv2.imencode(".png", image)[1].tobytes()
    except cv2.error:
        raise ValueError(f"an image of type {image.dtype} cannot be written as PNG") from None
