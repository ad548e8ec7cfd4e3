# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rig and depth of a bag as fuse_stack and the nodes check them: by the same code, in the same words."""
import json
import tempfile
from pathlib import Path
from typing import NamedTuple

from all_in_focus import installed
from all_in_focus.files.output_file import write_picture
from all_in_focus.files.rig import save_rig
from all_in_focus.imaging import shrunk

WIDTH = 640  # pixels to which larger pictures are reduced: enough for the check of mirroring


class RigWarnings(NamedTuple):
    """One line each, empty where there is nothing to say. apart: no depth falls into the picture, as overlap says.
    coverage: share of the picture that gets a depth."""
    unit: str
    circle_of_confusion: str
    pose: str
    overlap: str
    mirroring: str
    apart: bool
    coverage: float


def ask(rig, quaternion, depth, picture):
    """rig: Rig; quaternion: of its pose, x, y, z, w; depth: H x W mm; picture: H x W x 3 of the colour camera, or None.

    Returns RigWarnings. Raises RuntimeError where check_depth, a program of this package, cannot be run.
    """
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        save_rig(folder / "rig", rig, quaternion)
        write_picture(folder / "depth.png", depth)
        command = [installed.find("check_depth"), "--rig", str(folder / "rig"), "--depth", str(folder / "depth.png")]
        if rig.optics:
            command += ["--optics", ",".join(repr(float(value)) for value in vars(rig.optics).values())]
        if picture is not None:
            write_picture(folder / "color.png", shrunk(picture, WIDTH))
            command += ["--color", str(folder / "color.png")]
        return RigWarnings(**json.loads(installed.run(command)))
