# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writes the rig folder of a calibration: all of its files or none."""
import tempfile
from pathlib import Path

import cv2
import numpy as np

from all_in_focus.files.output_folder import read_mark, whole_folder
from all_in_focus.files.rig import Camera, Rig, load_rig, save_rig

FILES = ("depth.yaml", "color.yaml", "extrinsics.yaml", "optics.yaml", "calibration.yaml")


def refuse_existing(folder, force):
    """ValueError where the folder is no folder, or holds a rig that must not be replaced: without `force`, or one
    that calibrate_rig did not write."""
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder}: exists and is no folder")
    existing = [name for name in FILES if (folder / name).exists()]
    if existing and not force:
        raise ValueError(f"{folder}: holds a rig already ({', '.join(existing)}): name another folder, or say "
                         "--force")
    mark = read_mark(folder)
    foreign = sorted(set(existing) - {"optics.yaml"} - set(mark["files"] if mark else ()))
    if foreign:
        raise ValueError(f"{folder / foreign[0]}: was not written by calibrate_rig: name another folder, or "
                         "remove it")


def refuse_read_only(folder):
    """ValueError where nothing can be written. Tried before the work: nobody has to take the views twice."""
    whole = Path(folder).absolute()
    for place in (whole, whole.parent):  # the parent gets the staging folder
        while not place.exists() and not place.is_symlink():
            place = place.parent
        try:
            tempfile.TemporaryDirectory(dir=place).cleanup()
        except OSError as error:
            raise ValueError(f"{folder}: cannot be written, {place}: {error.strerror}")


def build_rig(fit, names, sizes, offset=(0.0, 0.0), optics=None):
    """Rig of a RigFit. names, sizes: of the depth and the colour camera; offset: added to the depth principal point."""
    shift = np.array([[0, 0, offset[0]], [0, 0, offset[1]], [0, 0, 0]])
    cameras = [_camera(name, size, K, part.D) for name, size, K, part in
               ((names[0], sizes[0], fit.depth.K + shift, fit.depth), (names[1], sizes[1], fit.color.K, fit.color))]
    return Rig(*cameras, fit.R, fit.t, optics)


def _camera(name, size, K, D):
    # P as camera_calibration computes it: the rectified picture without empty borders.
    rectified, _ = cv2.getOptimalNewCameraMatrix(K, D, size, 0)
    return Camera(name, size[0], size[1], K, D, "plumb_bob" if len(D) <= 5 else "rational_polynomial",
                  P=np.hstack([rectified, np.zeros((3, 1))]))


def write_rig(folder, rig, record, force=False):
    """Writes the rig and calibration.yaml (text). Files that calibrate_rig did not write stay, such as an optics.yaml
    where `rig` has no lens; one that would have to be replaced is an error."""
    refuse_existing(folder, force)
    with whole_folder(folder, "calibrate_rig", may_keep=lambda name: True, parents=True) as working:
        save_rig(working, rig)
        (working / "calibration.yaml").write_text(record, encoding="utf-8")
        load_rig(working)  # checks that it can be read before it replaces anything
