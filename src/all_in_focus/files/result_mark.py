# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The mark of pictures that this package has written: a later run does not take them for frames of a stack."""
import contextlib
import struct
import zlib
from pathlib import Path

from PIL import Image

SOFTWARE = 305  # EXIF
MARK = "all_in_focus"  # its value in a result; the ending of the file beside a result of a format without EXIF


def is_result(path):
    with contextlib.suppress(OSError, SyntaxError, ValueError), Image.open(path) as image:
        if str(image.getexif().get(SOFTWARE, "")).startswith(MARK):
            return True
    return Path(f"{path}.{MARK}").exists()


def marked(data):
    """A PNG or JPEG file with the mark of a result; other data as they are."""
    exif = Image.Exif()
    exif[SOFTWARE] = MARK
    block = exif.tobytes()
    if data.startswith(b"\x89PNG"):
        chunk = b"eXIf" + block[len(b"Exif\0\0"):]
        place = 33  # behind the first chunk, IHDR
        return b"".join([data[:place], struct.pack(">I", len(chunk) - 4), chunk, struct.pack(">I", zlib.crc32(chunk)),
                         data[place:]])
    if data.startswith(b"\xff\xd8"):
        return b"".join([data[:2], b"\xff\xe1", struct.pack(">H", len(block) + 2), block, data[2:]])
    return data
