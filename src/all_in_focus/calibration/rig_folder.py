# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The rig folder: all of its files or none."""
import os
import shutil
import tempfile

import cv2
import numpy as np

from all_in_focus.calibration import CalibrationError
from all_in_focus.files.output_file import named
from all_in_focus.files.rig import Camera, Rig, load_rig, save_rig

FILES = ("depth.yaml", "color.yaml", "extrinsics.yaml", "optics.yaml", "calibration.yaml")


def refuse_existing(folder, force):
    """CalibrationError where the folder cannot be made, or holds a rig that is not to be replaced."""
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise CalibrationError("%s: exists and is no folder" % folder)
    existing = [name for name in FILES if os.path.exists(os.path.join(folder, name))]
    if existing and not force:
        raise CalibrationError("%s: holds a rig already (%s): name another folder, or say --force"
                               % (folder, ", ".join(existing)))


def refuse_read_only(folder):
    """CalibrationError where nothing can be written, tried out: before somebody has stood there with the board."""
    whole = os.path.abspath(folder)
    for place in (whole, os.path.dirname(whole)):  # the parent holds the files until all are there
        while not os.path.lexists(place):
            place = os.path.dirname(place)
        try:
            tempfile.TemporaryDirectory(dir=place).cleanup()
        except OSError as error:
            raise CalibrationError("%s: cannot be written, %s: %s" % (folder, place, error.strerror))


def build_rig(fit, names, sizes, offset=(0.0, 0.0), optics=None):
    """Rig of a RigFit. names, sizes: of the depth and the colour camera; offset: added to the depth principal point."""
    shift = np.array([[0, 0, offset[0]], [0, 0, offset[1]], [0, 0, 0]])
    cameras = [_camera(name, size, K, part.D) for name, size, K, part in
               ((names[0], sizes[0], fit.depth.K + shift, fit.depth), (names[1], sizes[1], fit.color.K, fit.color))]
    return Rig(*cameras, fit.R, fit.t, optics)


def _camera(name, size, K, D):
    # P as camera_calibration gives it: the rectified picture, without empty edges.
    rectified, _ = cv2.getOptimalNewCameraMatrix(K, D, size, 0)
    return Camera(name, size[0], size[1], K, D, "plumb_bob" if len(D) <= 5 else "rational_polynomial",
                  P=np.hstack([rectified, np.zeros((3, 1))]))


def write_rig(folder, rig, record, force=False):
    """Write rig and calibration.yaml (text). Other files of an existing folder stay; so does its optics.yaml if the rig
    has none."""
    refuse_existing(folder, force)
    folder = os.path.abspath(folder)
    os.makedirs(os.path.dirname(folder), exist_ok=True)
    working = os.path.join(os.path.dirname(folder), ".%d.%s" % (os.getpid(), os.path.basename(folder)))
    try:
        with named(folder, working):
            os.mkdir(working)
            save_rig(working, rig)
            with open(os.path.join(working, "calibration.yaml"), "w", encoding="utf-8") as out:
                out.write(record)
            load_rig(working)  # what cannot be read is not put in anybody's place
            if os.path.isdir(folder):
                for name in os.listdir(working):
                    os.replace(os.path.join(working, name), os.path.join(folder, name))
            else:
                os.rename(working, folder)
    finally:
        shutil.rmtree(working, ignore_errors=True)
