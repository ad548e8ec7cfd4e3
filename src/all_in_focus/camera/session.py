# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One camera over time: connects, shoots brackets, reconnects after the camera was lost."""
import contextlib
from dataclasses import dataclass

from all_in_focus.camera.bracket import STILL, Bracketer, Photographer, planned_positions
from all_in_focus.camera.focus_drive import FocusDrive, RingDrive
from all_in_focus.camera.interface import NOT_SUPPORTED, CameraError, RetryingCamera
from all_in_focus.camera.makers import ALL_HOLDS, MAKERS, maker_of
from all_in_focus.camera.settings_hold import SettingsHold
from all_in_focus.files.focus_table import FocusTable

CURRENT, NEAR, FAR = "current", "near", "far"
MOTOR, NONE = "motor", "none"
RING_PAUSE = 1.0  # s, default time to turn the focus ring between two frames


@dataclass
class Config:
    """maker: name of a row of the table, "" = by the camera's own name; count, step, first: frames of a bracket, steps
    between them (+ is far), steps from the start position to the first; step_size: 0 = typical of the maker; settle_s:
    None = typical of the maker; home: where position 0 is, the focus at the start or a stop; table: of FocusTable,
    empty = not calibrated; drive: MOTOR, or NONE where a person turns the focus ring for settle_s between the frames."""
    drive: str = MOTOR
    maker: str = ""
    frames: str = STILL
    count: int = 9
    step: int = 1
    first: int = 0
    step_size: int = 0
    settle_s: float = None
    home: str = CURRENT
    table: tuple = ()
    patience_s: float = 5.0
    timeout_s: float = 10.0
    keep_files: bool = True
    white_balance: str = ""
    iso: str = ""


class Session:
    """clock: gives the stamps of the frames. All calls but close() may raise CameraError. One that loses the camera
    sets `connected` to false. After each call take_warnings() returns its warnings."""

    def __init__(self, camera, config, clock):
        self.config = config
        self.scale = FocusTable(config.table) if config.table else None
        self.connected = False
        self.model = self.description = ""  # of the camera, for people
        self._camera = RetryingCamera(camera, config.patience_s)
        self._photographer = Photographer(self._camera, clock, config.frames, config.timeout_s,
                                          keep_files=config.keep_files)
        self._maker, self._bracketer = None, None
        self._warnings = []

    @contextlib.contextmanager
    def _watching(self):
        """Closes the camera when it is lost."""
        try:
            yield
        except CameraError as error:
            if error.lost:
                self.close()
            raise

    def connect(self):
        """Open the camera, and restore what an interrupted bracket has left changed."""
        try:
            self.model = self._camera.open()
            self._photographer.reset()
            maker = self._maker_of(self.model)
            if self._bracketer is None or self._maker is not maker:
                self._maker, self._bracketer = maker, self._bracketer_for(maker)
            if self.config.home != CURRENT:
                self._bracketer.drive.go_to_stop(self.config.home == FAR)
            self._bracketer.restore(self._warnings)
        except Exception:
            self.close()
            raise
        self.connected = True
        if self.config.drive == NONE:
            self.description = f"{self.model}, focused by hand"
        else:
            limit = "" if maker.reports_limit else " (which do not report their focus limit)"
            self.description = f"{self.model}, focused as {maker.name} cameras are{limit}"

    def _maker_of(self, model):
        names = [self.config.maker or model]
        if not self.config.maker and maker_of(model) is None:
            with contextlib.suppress(CameraError):
                names.append(str(self._camera.get_config("manufacturer").value))
        maker = maker_of(*names)
        if maker is None and self.config.drive != NONE:
            makers = ", ".join(maker.name for maker in MAKERS)
            raise CameraError(NOT_SUPPORTED, f"'{model}'", "its focus cannot be driven from here, only that of "
                              f"{makers}: use image_folder_camera, or ~drive:=none and turn the focus ring by hand")
        return maker

    def _bracketer_for(self, maker):
        if self.config.drive == NONE:
            drive = RingDrive(RING_PAUSE if self.config.settle_s is None else self.config.settle_s)
        else:
            drive = FocusDrive(self._camera, maker, self.config.step_size, self.config.settle_s)
        hold = SettingsHold(self._camera, maker.holds if maker else ALL_HOLDS, self.config.white_balance, self.config.iso)
        return Bracketer(drive, hold, self._photographer, self.scale)

    def shoot(self, publish, on_release=lambda shot: None, exposures=()):
        """A bracket of equal steps; see Bracketer.shoot()."""
        self._restore()
        config = self.config
        first, step = (0, 1) if config.drive == NONE else (config.first, config.step)
        start = self._bracketer.drive.position + first
        self._shoot([start + index * step for index in range(config.count)], publish, on_release, exposures)

    def shoot_planned(self, distances, publish, on_release=lambda shot: None, exposures=()):
        """A bracket at these distances (m), from near to far or from far to near; needs a table."""
        positions, exposures, warnings = planned_positions(distances, self.scale, exposures)
        self._warnings += warnings
        self._restore()
        self._shoot(positions, publish, on_release, exposures)

    def _shoot(self, positions, publish, on_release, exposures):
        with self._watching():
            self._bracketer.shoot(positions, publish, on_release, self._warnings, exposures)

    def check(self):
        """Raises CameraError if the camera is no longer there."""
        with self._watching():
            self._photographer.drain()
        self._restore()

    def _restore(self):
        """Restore what the last bracket could not, because the camera was busy, for example."""
        with self._watching():
            self._bracketer.restore(self._warnings)

    def take_warnings(self):
        """Warnings since the last call, one line each."""
        warnings = self._warnings + self._photographer.take_warnings()
        self._warnings.clear()
        return warnings

    def close(self):
        self.connected = False
        self._camera.close()
