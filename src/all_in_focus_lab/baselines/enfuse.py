# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The program enfuse (exposure and focus fusion in Laplacian pyramids), set to choose by contrast alone."""
import shutil
import tempfile
from pathlib import Path

import cv2

from all_in_focus import installed

OPTIONS = ["--exposure-weight=0", "--saturation-weight=0", "--contrast-weight=1", "--hard-mask"]


def fuse(images):
    """See all_in_focus_lab.baselines; returns no weights. RuntimeError where enfuse is not installed or fails."""
    if shutil.which("enfuse") is None:
        raise RuntimeError("enfuse is not installed")
    with tempfile.TemporaryDirectory() as folder:
        paths = [str(Path(folder) / f"{number:04d}.png") for number in range(len(images))]
        for path, image in zip(paths, images):
            cv2.imwrite(path, image)
        output = str(Path(folder) / "fused.png")
        installed.run(["enfuse", *OPTIONS, "--output=" + output, *paths])
        return cv2.imread(output), None
