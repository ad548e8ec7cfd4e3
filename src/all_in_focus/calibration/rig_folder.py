# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writes the rig folder of a calibration: all of its files or none."""
import shutil
from pathlib import Path

import cv2
import numpy as np

from all_in_focus.files.output_folder import OutputFolder, read_mark
from all_in_focus.files.rig import Camera, Rig, load_rig, save_rig

FILES = ("depth.yaml", "color.yaml", "extrinsics.yaml", "optics.yaml", "calibration.yaml")
# The depth image of a Kinect v1 lies higher and more to the left than its IR picture, by half a correlation window:
# http://wiki.ros.org/kinect_calibration/technical measured it, openni_camera takes (-5, -4).
KINECT_IR_OFFSET = (-4.8, -3.9)
# libfreenect's infrared pictures have eight rows more than its depth images.
KINECT_IR_SIZE, KINECT_DEPTH_SIZE = (640, 488), (640, 480)


class RigFolder(OutputFolder):
    """The folder of one calibration; made before the work: nobody has to take the views twice. write() puts the rig there;
    discard() must follow.

    An earlier rig is a ValueError unless `force`. A rig of others is an OSError. Where the new rig has no lens, optics.yaml
    stays; files that are no part of a rig stay anyway.
    """

    def __init__(self, path, force=False, has_optics=False):
        existing = [name for name in FILES if (Path(path) / name).exists()]
        if existing and not force:
            raise ValueError(f"{path}: holds a rig already ({', '.join(existing)}): name another folder, or say --force")
        written = set(FILES) - (set() if has_optics else {"optics.yaml"})
        super().__init__(path, "calibrate_rig", may_keep=lambda name: name not in written, parents=True)

    def write(self, rig, record):
        """record: text of calibration.yaml."""
        save_rig(self.working, rig)
        (self.working / "calibration.yaml").write_text(record, encoding="utf-8")
        optics, mark = self.path / "optics.yaml", read_mark(self.path)
        if rig.optics is None and optics.exists() and mark and optics.name in (mark["files"] or ()):
            shutil.copy(optics, self.working)  # commit() removes what an earlier run has written
        load_rig(self.working)  # checks that it can be read before it replaces anything
        self.commit()


def depth_size(picture_size, is_kinect):
    """Size (width, height) of the depth images of a camera whose infrared pictures have `picture_size`."""
    return KINECT_DEPTH_SIZE if is_kinect and picture_size == KINECT_IR_SIZE else picture_size


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
