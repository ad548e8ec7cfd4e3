# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of a board that both cameras took at once, paired by name."""
import os
from dataclasses import dataclass
from typing import Optional

import cv2
import numpy as np

from all_in_focus.calibration import CalibrationError
from all_in_focus.calibration.board import find_corners
from all_in_focus.files.stack import StackError, is_image_name, read_image

CAMERAS = ("depth", "color")


@dataclass
class Pair:
    """Corners of the board (N x 2, pixels) in the two pictures of one moment; None where it is not seen.

    unreadable: a line where a picture cannot be read.
    """
    name: str
    depth: Optional[np.ndarray]
    color: Optional[np.ndarray]
    unreadable: str = ""


class PairFolders:
    """Two folders of pictures; files of the same name, whatever the ending, are a pair. warnings: one line each."""

    def __init__(self, depth_folder, color_folder):
        self._folders = (depth_folder, color_folder)
        files = [_images(folder) for folder in self._folders]
        self.names = sorted(set(files[0]) & set(files[1]))
        if not self.names:
            raise CalibrationError("no picture of %s has a counterpart of the same name in %s" % self._folders)
        self.warnings = ["%s: no picture in %s is named like %s: left out"
                         % (folder, other, ", ".join(sorted(set(own) - set(others))))
                         for folder, own, other, others in ((self._folders[0], files[0], self._folders[1], files[1]),
                                                            (self._folders[1], files[1], self._folders[0], files[0]))
                         if set(own) - set(others)]
        self._files = files
        self.sizes = [None, None]  # (width, height) of the cameras' pictures
        self._first = [None, None]  # name of the first that can be read

    def pairs(self, board):
        """Reads and searches one pair after the other. CalibrationError where no picture of a camera can be read."""
        for name in self.names:
            corners, complaints = [None, None], []
            for camera in (0, 1):
                try:
                    corners[camera] = find_corners(self._read(camera, name), board)
                except StackError as error:
                    complaints.append(str(error))
            yield Pair(name, *corners, "; ".join(complaints))
        for folder, first in zip(self._folders, self._first):
            if first is None:
                raise CalibrationError("%s: none of the %d pictures can be read" % (folder, len(self.names)))

    def first_picture(self, camera):
        """The first that can be read; call after pairs()."""
        return self._read(camera, self._first[camera])

    def _read(self, camera, name):
        path = os.path.join(self._folders[camera], self._files[camera][name])
        image = read_image(path, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        size = image.shape[1::-1]
        self._first[camera] = self._first[camera] or name
        self.sizes[camera] = self.sizes[camera] or size
        if size != self.sizes[camera]:
            raise CalibrationError("%s: %dx%d pixels, but the %s camera's pictures before it have %dx%d"
                                   % ((path,) + size + (CAMERAS[camera],) + self.sizes[camera]))
        return image


def _images(folder):
    """File names by stem."""
    try:
        names = sorted(filter(is_image_name, os.listdir(folder)))
    except OSError as error:
        raise CalibrationError("%s: %s" % (folder, error.strerror))
    if not names:
        raise CalibrationError("%s: holds no images" % folder)
    stems = [os.path.splitext(name)[0] for name in names]
    for stem, name, other in zip(stems[1:], names[1:], names):
        if os.path.splitext(other)[0] == stem:
            raise CalibrationError("%s: %s and %s differ in their ending only: which is it?" % (folder, other, name))
    return dict(zip(stems, names))
