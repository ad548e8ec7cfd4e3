# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is asked of a camera: the calls of libgphoto2 that a focus bracket needs, and its errors in plain words."""
import re
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

_EXPLANATIONS = {
    **dict.fromkeys(NOT_THERE, "no camera found: switch it on and check the USB cable"),
    **dict.fromkeys(CLAIMED, "the camera is claimed by another program, mostly the desktop's volume monitor (gvfs): "
                             "run 'gio mount -s gphoto2' or stop gvfs-gphoto2-volume-monitor"),
    **dict.fromkeys(BROKEN, "the connection to the camera broke: it is off, asleep or unplugged"),
    UNKNOWN_PORT: "libgphoto2 knows none of this name: see 'gphoto2 --auto-detect'",
    BUSY: "the camera is busy: it still writes, or somebody uses its menu or buttons",
    CAMERA_ERROR: "the camera could not do it",
    CORRUPTED: "the camera sent what cannot be read",
    NO_SPACE: "the memory card is full",
    NOT_SUPPORTED: "the camera does not support this",
}


class CameraError(Exception):
    """code: of libgphoto2; detail: what the driver said besides, "" if nothing. The text is one line for people."""

    def __init__(self, code, doing="", detail=""):
        self.code, self.detail = code, " ".join(detail.split())
        reason = _EXPLANATIONS.get(code, "the camera refused")
        text = "%s (libgphoto2: %d%s)" % (reason, code, ", " + self.detail if self.detail else "")
        super().__init__("%s: %s" % (doing, text) if doing else text)

    @property
    def busy(self):
        """Worth another try in a moment."""
        return self.code == BUSY

    @property
    def lost(self):
        """The camera has to be opened again."""
        return self.code in NOT_THERE | CLAIMED | BROKEN

    @property
    def at_limit(self):
        """A focus drive ended at its stop."""
        return self.code == CAMERA_ERROR and re.search("limit|step end", self.detail, re.I) is not None


@dataclass
class Widget:
    """One setting. value: text, or a number where the widget is a range or a toggle."""
    name: str
    value: object
    choices: list = field(default_factory=list)
    low: Optional[float] = None
    high: Optional[float] = None
    read_only: bool = False


class Camera:
    """The narrow interface; every call but close() may raise CameraError. A path is the full name on the camera.

    open() -> name of the model; close()
    get_config(name) -> Widget; a widget that does not exist raises BAD_PARAMETERS or ERROR
    set_config(name, value)
    capture(): releases the shutter and returns at once; the picture arrives by wait_for_event()
    wait_for_event(seconds) -> path of the new file, None if the event is another or none came
    capture_preview() -> bytes of a JPEG picture
    download(path) -> bytes; delete(path)
    """

    def open(self):
        raise NotImplementedError

    def close(self):
        raise NotImplementedError

    def get_config(self, name):
        raise NotImplementedError

    def set_config(self, name, value):
        raise NotImplementedError

    def capture(self):
        raise NotImplementedError

    def wait_for_event(self, seconds):
        raise NotImplementedError

    def capture_preview(self):
        raise NotImplementedError

    def download(self, path):
        raise NotImplementedError

    def delete(self, path):
        raise NotImplementedError
