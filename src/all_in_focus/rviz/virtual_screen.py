# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A virtual screen (Xvfb) and pictures of it."""
import os
import select
import shutil
import subprocess
import time

import cv2
import numpy as np

PACKAGES = {"Xvfb": "xvfb", "import": "imagemagick", "rviz": "rviz"}  # on Debian, by program
START = 30.0  # s for Xvfb to come up
PERIOD = 0.5  # s between pictures that are compared
UNCHANGED = 0.002  # share of pixels that may differ: rviz shows its frame rate


class ScreenError(RuntimeError):
    """No screen could be started, or it does not show what it should; the message is one line."""


def check_programs(*programs):
    """ScreenError that names the packages of the missing programs."""
    missing = [program for program in programs if shutil.which(program) is None]
    if missing:
        raise ScreenError(f"{' and '.join(missing)} missing: install "
                          f"{' '.join(PACKAGES.get(program, program) for program in missing)} (scripts/build "
                          "--with-rviz does)")


class VirtualScreen:
    """Xvfb on a free display number; it renders OpenGL in software."""

    def __init__(self, width=1600, height=1000):
        check_programs("Xvfb", "import")
        reader, writer = os.pipe()
        command = ["Xvfb", "-displayfd", str(writer), "-screen", "0", f"{width}x{height}x24", "-nolisten", "tcp"]
        self._process = subprocess.Popen(command, pass_fds=[writer], stdin=subprocess.DEVNULL,
                                         stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(writer)
        with os.fdopen(reader) as numbers:
            ready, _, _ = select.select([numbers], [], [], START)
            number = numbers.readline().strip() if ready else ""
        if not number:
            self.close()
            raise ScreenError("Xvfb did not start")
        self.display = f":{number}"

    def close(self):
        self._process.terminate()
        self._process.wait()

    def picture(self):
        """The whole screen, BGR."""
        shot = subprocess.run(["import", "-display", self.display, "-window", "root", "png:-"], check=False,
                              stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        image = cv2.imdecode(np.frombuffer(shot.stdout, np.uint8), cv2.IMREAD_COLOR) if shot.stdout else None
        if image is None:
            raise ScreenError(f"no picture of the screen: {' '.join(shot.stderr.decode(errors='replace').split())}")
        return image

    def settled_picture(self, accept, timeout):
        """Waits for three equal pictures in a row that `accept` accepts. Raises ScreenError after `timeout` s."""
        end = time.monotonic() + timeout
        last, equal = self.picture(), 1
        while not (equal >= 3 and accept(last)):
            if time.monotonic() > end:
                raise ScreenError(f"the screen does not show what it should after {timeout:g} s")
            time.sleep(PERIOD)
            new = self.picture()
            equal = equal + 1 if changed_share(last, new) < UNCHANGED else 1
            last = new
        return last


def changed_share(one, other):
    """Share of the pixels in which two pictures of one size differ."""
    return float((one != other).any(axis=2).mean())
