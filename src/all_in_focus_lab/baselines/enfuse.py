# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The program enfuse (exposure and focus fusion in Laplacian pyramids), set to choose by contrast alone."""
import shutil
import subprocess
import tempfile
from pathlib import Path

import cv2

OPTIONS = ["--exposure-weight=0", "--saturation-weight=0", "--contrast-weight=1", "--hard-mask"]


def fuse(images):
    """See all_in_focus_lab.baselines; returns no weights. RuntimeError where enfuse is not installed or fails."""
    program = shutil.which("enfuse")
    if program is None:
        raise RuntimeError("enfuse is not installed")
    with tempfile.TemporaryDirectory() as folder:
        paths = [str(Path(folder) / f"{number:04d}.png") for number in range(len(images))]
        for path, image in zip(paths, images):
            cv2.imwrite(path, image)
        output = str(Path(folder) / "fused.png")
        result = subprocess.run([program, *OPTIONS, "--output=" + output, *paths], stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT, universal_newlines=True, errors="replace")
        if result.returncode:
            said = result.stdout.strip().splitlines() or [f"exit code {result.returncode}"]
            raise RuntimeError("enfuse: " + said[-1])
        return cv2.imread(output), None
