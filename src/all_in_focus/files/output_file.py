# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writes files that are complete or not there: beside their place first, then renamed in one step."""
import contextlib
import json
import os
from pathlib import Path

import cv2


@contextlib.contextmanager
def named(path, working):
    """Re-raises OSErrors about the temporary file or folder `working` with the user's path instead. An OSError that names no
    file, as that of a full disk, gets the user's path, too."""
    path, working = Path(path), Path(working)
    try:
        yield
    except OSError as error:
        place = working if error.filename is None else Path(str(error.filename))
        if error.errno is None or working not in (place, *place.parents):
            raise
        raise OSError(error.errno, error.strerror, str(path / place.relative_to(working))) from None


@contextlib.contextmanager
def whole_file(path):
    """Yields the Path to write to. It replaces `path` at the end, in one step; on an error nothing is left behind."""
    path = Path(path)
    working = path.with_name(f".{os.getpid()}.{path.name}")  # keeps the suffix, which may choose the format
    try:
        with named(path, working):
            yield working
            os.replace(working, path)
    finally:
        if working.exists():
            working.unlink()


def write_picture(path, image):
    """Writes an image file in the format of its suffix, PNG without one. ValueError for other suffixes."""
    try:
        data = cv2.imencode(Path(path).suffix or ".png", image)[1].tobytes()
    except cv2.error:
        raise ValueError(f"{path}: no image format has this ending: use .png") from None
    with whole_file(path) as working:
        working.write_bytes(data)


def write_json(path, data):
    """Writes a JSON file; ValueError for NaN and infinity, which JSON does not know."""
    text = json.dumps(data, indent=2, allow_nan=False) + "\n"
    with whole_file(path) as working:
        working.write_text(text, encoding="utf-8")


def encode_png(image):
    """PNG file as bytes; colour images are BGR. ValueError where the type of the image does not fit PNG."""
    try:
        good, data = cv2.imencode(".png", image)
    except cv2.error:
        good = False
    if not good:
        raise ValueError(f"an image of type {image.dtype} cannot be written as PNG")
    return data.tobytes()
