# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small stacks on disk, and the command line tools as people call them."""
import os
import struct
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

SCRIPTS = Path(__file__).resolve().parent.parent / "scripts"
SIZE = (48, 32)  # width, height
# A BMP of 2^21 x 2^21 pixels, as far as its header goes: OpenCV does not even try.
ENDLESS_PICTURE = b"BM" + struct.pack("<IHHI IiiHHIIiiII", 54, 0, 0, 54, 40, 1 << 21, 1 << 21, 1, 24, *(0,) * 6)


def pictures(count, size=SIZE, seed=0):
    random = np.random.default_rng(seed)
    return [random.integers(0, 256, (size[1], size[0], 3), np.uint8) for _ in range(count)]


def write_stack(folder, names, frames=None):
    folder.mkdir(exist_ok=True)
    for name, frame in zip(names, frames or pictures(len(names))):
        cv2.imwrite(str(folder / name), frame)
    return folder


def write_video(path, frames):
    frames = list(frames)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, frames[0].shape[1::-1])
    for frame in frames:
        video.write(frame)
    video.release()
    return path


def cut(path, share=0.6):
    """Leaves the first part of a file."""
    data = Path(path).read_bytes()
    Path(path).write_bytes(data[:int(len(data) * share)])


def focus_file(tmp_path, text):
    path = tmp_path / "focus.yaml"
    path.write_text(text)
    return path


def run_script(name, *arguments, timeout=300):
    path = os.pathsep.join(["/usr/bin", "/bin", os.environ.get("PATH", "")])
    return subprocess.run([sys.executable, SCRIPTS / name, *map(str, arguments)], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, universal_newlines=True, env=dict(os.environ, PATH=path), timeout=timeout)
