# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files and folders that are written beside their place and put there when they are whole."""
import contextlib
import os

import cv2


@contextlib.contextmanager
def named(path, working):
    """Errors at the working file or folder are told as of `path`: people know no other."""
    try:
        yield
    except OSError as error:
        place = str(error.filename)
        if place != working and not place.startswith(os.path.join(working, "")):
            raise
        raise OSError(error.errno, error.strerror, path + place[len(working):]) from None


@contextlib.contextmanager
def whole_file(path):
    """Path to write to. What is there takes the place of `path` in one step; on an error nothing is left behind."""
    folder, name = os.path.split(path)
    working = os.path.join(folder, ".%d.%s" % (os.getpid(), name))  # keeps the ending, which may say the format
    try:
        with named(path, working):
            yield working
            os.replace(working, path)
    finally:
        if os.path.exists(working):
            os.remove(working)


def write_picture(path, image):
    """A whole picture file of the format that its ending says, PNG without one. ValueError for other endings."""
    try:
        data = cv2.imencode(os.path.splitext(path)[1] or ".png", image)[1].tobytes()
    except cv2.error:
        raise ValueError("%s: no image format has this ending: use .png" % path)
    with whole_file(path) as working, open(working, "wb") as file:
        file.write(data)
