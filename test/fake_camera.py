# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A fake camera that behaves as those of each maker do through libgphoto2."""
import time
from types import SimpleNamespace

import cv2
import numpy as np

from all_in_focus.camera.bracket_node import PARAMETERS
from all_in_focus.camera.interface import (BAD_PARAMETERS, BUSY, CAMERA_ERROR, ERROR, FILE_NOT_FOUND, IO_WRITE,
                                           MODEL_NOT_FOUND, CameraError, Widget)

SIZE = (48, 32)  # width, height of a picture
LENS = 1000  # motor positions from the near limit, 0, to the far limit
CHOICE_STEPS = {1: 10, 2: 50, 3: 200}  # motor positions of a Canon's Near/Far 1, 2, 3
WHITE_BALANCES = ["Auto", "Daylight", "Tungsten"]
DRIVES = {"Canon EOS": ["Near 1", "Near 2", "Near 3", "None", "Far 1", "Far 2", "Far 3"],
          "Panasonic": ["Near 1", "Near 2", "None", "Far 1", "Far 2"]}
MODELS = {"Canon EOS": "Canon EOS 80D", "Nikon": "Nikon DSC D750", "Sony": "Sony Alpha-A7 III (PC Control)",
          "Fuji": "Fuji Fujifilm X-T4", "Panasonic": "Panasonic DC-GH5", "none": "Pentax K-1"}


def picture_of(lens, size=SIZE):
    """The picture at this lens position: its grey level is the position, times 255 / LENS."""
    return np.full((size[1], size[0], 3), round(255 * lens / LENS), np.uint8)


def lens_of(picture):
    return float(np.mean(picture)) * LENS / 255


def camera_settings(**given):
    """Values of the parameters of focus_bracket_camera."""
    return SimpleNamespace(**{**{name: one.default for name, one in PARAMETERS.items()}, **given})


class FakeCamera:
    """Has the calls of GphotoCamera. make: a key of MODELS. All calls take `latency` seconds; a picture arrives `exposure`
    seconds after the release. cards: number of memory cards, each of which gets a copy; the second one `second_card`
    seconds after the first.

    See also press() and develop(). To provoke errors: busy (the next so many calls are refused as busy), unplug(), plug(),
    open_errors (the error codes of the next calls of open()), fail (code, n: the n-th call from now on fails).
    """

    def __init__(self, make="Canon EOS", lens=400, latency=0.0, exposure=0.01, raw=False, cards=1, second_card=0.0):
        self.make, self.lens, self.latency, self.exposure, self.raw = make, lens, latency, exposure, raw
        self.cards, self.second_card = cards, second_card
        self.texture = None  # see picture()
        self.refuses = []  # (name, value): settings that are refused
        self.busy, self.open_errors, self.fail = 0, [], None
        self.log = []  # (name, value) of every set_config
        self.files, self.deleted = {}, []
        self._plugged, self._open = True, False
        self._pending = []  # time when it is there, path
        self._drive_was = "None"
        self._shots = 0
        self.widgets = {widget.name: widget for widget in self._widgets()}

    def _widgets(self):
        yield Widget("whitebalance", "Auto", list(WHITE_BALANCES))
        yield Widget("iso", "Auto", ["Auto", "100", "200", "400"])
        yield Widget("shutterspeed", "1/60", ["1/30", "1/60", "1/125"])
        mode = "autoexposuremode" if self.make == "Canon EOS" else "expprogram"
        yield Widget(mode, "AV" if self.make == "Canon EOS" else "A", ["P", "AV", "A", "TV", "Manual", "M"])
        if self.make in ("Canon EOS", "Nikon"):
            yield Widget("autofocus", "On", ["On", "Off"])
        if self.make in ("Canon EOS", "Nikon", "Panasonic"):
            yield Widget("viewfinder", 0)
        if self.make in DRIVES:
            yield Widget("manualfocusdrive", "None", DRIVES[self.make])
        if self.make == "Nikon":
            yield Widget("manualfocusdrive", 0.0, low=-32767.0, high=32767.0)
        if self.make == "Sony":
            yield Widget("focusmode", "Automatic", ["Automatic", "Manual"])
            yield Widget("manualfocus", 0.0, low=-7.0, high=7.0)
        if self.make == "Fuji":
            yield Widget("focuspos", float(self.lens), low=0.0, high=float(LENS))

    # --- what a test can do to the camera

    def unplug(self):
        self._plugged = self._open = False

    def plug(self):
        self._plugged = True

    def press(self, lens):
        """Somebody presses the shutter, with the lens at this position."""
        was, self.lens = self.lens, lens
        self._release()
        self.lens = was

    def develop(self):
        """The pictures that were taken are there at once."""
        self._pending = [(0.0, event) for _, event in self._pending]

    def picture(self):
        """What the camera sees: the grey level of the lens position or, with `texture`, a random pattern: "moves" is
        sharpest at the near limit, "stands still" is always the same."""
        if self.texture is None:
            return picture_of(self.lens)
        picture = np.random.default_rng(0).integers(60, 200, (240, 360)).astype(np.uint8)
        picture = cv2.GaussianBlur(picture, (0, 0), 1 + (self.lens / 50 if self.texture == "moves" else 8))
        picture = cv2.normalize(picture.astype(np.float32), None, 60, 200, cv2.NORM_MINMAX)
        noise = np.random.default_rng().normal(0, 3, picture.shape)
        return cv2.cvtColor(np.clip(picture + noise, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)

    def _call(self, doing):
        time.sleep(self.latency)
        if not self._open:
            raise CameraError(IO_WRITE, doing)
        if self.fail:
            code, calls = self.fail
            self.fail = (code, calls - 1) if calls > 1 else None
            if calls == 1:
                raise CameraError(code, doing)
        if self.busy > 0:
            self.busy -= 1
            raise CameraError(BUSY, doing)

    # --- the interface

    def open(self):
        time.sleep(self.latency)
        if self.open_errors:
            raise CameraError(self.open_errors.pop(0), "opening the camera")
        if not self._plugged:
            raise CameraError(MODEL_NOT_FOUND, "opening the camera")
        self._open = True
        if "viewfinder" in self.widgets:
            self.widgets["viewfinder"].value = 0
        return MODELS[self.make]

    def close(self):
        self._open = False

    def get_config(self, name):
        self._call(f"reading '{name}'")
        if name not in self.widgets:
            raise CameraError(ERROR, f"reading '{name}'")
        widget = self.widgets[name]
        value = float(self.lens) if name == "focuspos" else widget.value
        return Widget(name, value, list(widget.choices), widget.low, widget.high, widget.read_only)

    def set_config(self, name, value):
        doing = f"setting '{name}' to {value}"
        self._call(doing)
        widget = self.widgets.get(name)
        if widget is None:
            raise CameraError(ERROR, doing)
        outside = widget.low is not None and not widget.low <= value <= widget.high
        if (name, value) in self.refuses or widget.read_only or outside or (widget.choices and value not in widget.choices):
            raise CameraError(BAD_PARAMETERS, doing)
        self.log.append((name, value))
        if name in ("manualfocusdrive", "manualfocus", "focuspos"):
            self._move(value, doing)
        else:
            widget.value = value
        if name in ("autoexposuremode", "expprogram"):  # each mode has a shutter speed of its own
            self.widgets["shutterspeed"].value = "1/125" if value in ("Manual", "M") else "1/60"

    def _move(self, value, doing):
        if self.make in ("Canon EOS", "Nikon", "Panasonic") and not self.widgets["viewfinder"].value:
            raise CameraError(ERROR, doing, "works only in LiveView mode")
        if self.make == "Sony" and self.widgets["focusmode"].value != "Manual":
            raise CameraError(ERROR, doing, "not in manual focus")
        if self.make == "Fuji":
            self.lens = int(value)
            return
        if self.make in DRIVES:
            same, self._drive_was = value == self._drive_was, value
            if same or value == "None":
                return  # unchanged: libgphoto2 does not even send it
            way, size = value.split()
            motor = CHOICE_STEPS[int(size)] * (1 if way == "Far" else -1)
        else:
            motor = int(value) * (10 if self.make == "Sony" else 1)
        wanted = self.lens + motor
        self.lens = min(max(wanted, 0), LENS)
        if self.make == "Nikon" and self.lens != wanted:
            raise CameraError(CAMERA_ERROR, doing, "Nikon manual focus at limit.")

    def capture(self):
        self._call("releasing the shutter")
        self._release()
        if self.make == "Nikon":
            self.widgets["viewfinder"].value = 0  # the mirror has moved

    def _release(self):
        self._shots += 1
        picture = cv2.imencode(".jpg", self.picture(), [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
        at = time.monotonic() + self.exposure
        for card in range(self.cards):
            for suffix, content in ([("CR2", b"raw")] if self.raw else []) + [("JPG", picture)]:
                path = f"/store_0001000{card + 1}/DCIM/100FAKE/IMG_{self._shots:04d}.{suffix}"
                self.files[path] = content
                self._pending += [(at + card * self.second_card, event) for event in ("", path)]
        self._pending.sort(key=lambda item: item[0])

    def wait_for_event(self, seconds):
        self._call("waiting for the camera")
        end = time.monotonic() + seconds
        while True:
            if self._pending and self._pending[0][0] <= time.monotonic():
                return self._pending.pop(0)[1]
            if time.monotonic() > end:
                return None
            time.sleep(0.002)

    def capture_preview(self):
        self._call("reading live view")
        return cv2.imencode(".jpg", picture_of(self.lens, (24, 16)))[1].tobytes()

    def download(self, path):
        self._call(f"downloading {path}")
        if path not in self.files:
            raise CameraError(FILE_NOT_FOUND, f"downloading {path}")
        return self.files[path]

    def delete(self, path):
        self._call(f"deleting {path}")
        self.deleted.append(path)
        del self.files[path]
