# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What sessions know of cameras: settings, errors explained, and retries. Their calls are those of gphoto.GphotoCamera."""
import functools
import re
import time
from dataclasses import dataclass, field
from typing import Optional

# Result codes of libgphoto2 (gphoto2-result.h, gphoto2-port-result.h).
ERROR, UNKNOWN_PORT, NOT_SUPPORTED, IO, TIMEOUT, BAD_PARAMETERS = -1, -5, -6, -7, -10, -2
IO_INIT, IO_READ, IO_WRITE, USB_FIND, USB_CLAIM, IO_LOCK = -31, -34, -35, -52, -53, -60
CORRUPTED, MODEL_NOT_FOUND, FILE_NOT_FOUND, BUSY = -102, -105, -108, -110
CAMERA_ERROR, OS_FAILURE, NO_SPACE = -113, -114, -115

NOT_THERE = {MODEL_NOT_FOUND, USB_FIND}
CLAIMED = {USB_CLAIM, IO_LOCK}
BROKEN = {IO, TIMEOUT, IO_INIT, IO_READ, IO_WRITE, OS_FAILURE}

PAUSE = 0.1  # s, between retries

_EXPLANATIONS = {
    **dict.fromkeys(NOT_THERE, "no camera found: switch it on and check the USB cable"),
    **dict.fromkeys(CLAIMED, "the camera is claimed by another program, mostly the desktop's volume monitor (gvfs): "
                             "run 'gio mount -s gphoto2' or stop gvfs-gphoto2-volume-monitor"),
    **dict.fromkeys(BROKEN, "the connection to the camera broke: it is off, asleep or unplugged"),
    UNKNOWN_PORT: "libgphoto2 does not know this name: see 'gphoto2 --auto-detect'",
    BUSY: "the camera is busy: it is still writing, or somebody uses its menu or buttons",
    CAMERA_ERROR: "the camera reported an error",
    CORRUPTED: "the camera sent data that cannot be read",
    NO_SPACE: "the memory card is full",
    NOT_SUPPORTED: "the camera does not support this",
}


class CameraError(Exception):
    """code: result code of libgphoto2; doing: what was tried; detail: the driver's own message. str() is one line.

    busy: the same call may succeed in a moment. lost: the connection is gone: the camera has to be opened again. at_limit: the
    focus drive has reached the end of its range.
    """

    def __init__(self, code, doing="", detail=""):
        self.code, detail = code, " ".join(detail.split())
        reason = _EXPLANATIONS.get(code, "the camera refused")
        text = f"{reason} (libgphoto2: {code}{', ' + detail if detail else ''})"
        super().__init__(f"{doing}: {text}" if doing else text)
        self.busy = code == BUSY
        self.lost = code in NOT_THERE | CLAIMED | BROKEN
        self.at_limit = code == CAMERA_ERROR and re.search("limit|step end", detail, re.I) is not None


@dataclass
class Widget:
    """One setting. value: a text, or a number where the widget is a range or a toggle."""
    name: str
    value: object
    choices: list = field(default_factory=list)
    low: Optional[float] = None
    high: Optional[float] = None
    read_only: bool = False


def find_widget(camera, name):
    """The widget; None if the camera has none of this name. Raises CameraError only if the camera is lost."""
    try:
        return camera.get_config(name)
    except CameraError as error:
        if error.lost:
            raise
        return None


class RetryingCamera:
    """Forwards every call to `camera`, repeats it for up to `patience` seconds while the camera is busy, and closes it
    when it is lost. connected: set by whoever has opened it, until it is closed."""

    def __init__(self, camera, patience=5.0):
        self._camera, self._patience = camera, patience
        self.connected = False

    def _retry(self, call, *arguments):
        end = time.monotonic() + self._patience
        while True:
            try:
                return call(*arguments)
            except CameraError as error:
                if error.lost:
                    self.close()
                if not error.busy or time.monotonic() + PAUSE > end:
                    raise
            time.sleep(PAUSE)

    def __getattr__(self, name):
        return functools.partial(self._retry, getattr(self._camera, name))

    def close(self):
        self.connected = False
        self._camera.close()

    def capture(self, before_attempt=None):
        """before_attempt: called before each attempt; the last call is the one just before the shutter."""
        def attempt():
            if before_attempt:
                before_attempt()
            self._camera.capture()
        self._retry(attempt)
