# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One camera over time: connects, shoots brackets, reconnects after the camera was lost."""
import contextlib
from dataclasses import dataclass

from all_in_focus.camera.bracket import STILL, Bracketer, Photographer, planned_positions
from all_in_focus.camera.focus_drive import FocusDrive, FocusScale
from all_in_focus.camera.interface import NOT_SUPPORTED, CameraError, RetryingCamera
from all_in_focus.camera.makers import MAKERS, maker_of
from all_in_focus.camera.settings_hold import SettingsHold

CURRENT, NEAR, FAR = "current", "near", "far"


@dataclass
class Config:
    """maker: name of a row of the table, "" = by the camera's own name; count, step, first: frames of a bracket, steps
    between them (+ is far), steps from the start position to the first; step_size: 0 = typical of the maker; settle_s:
    None = typical of the maker; home: where position 0 is, the focus at the start or a stop; table: of FocusScale,
    empty = not calibrated."""
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
    sets `connected` to false."""

    def __init__(self, camera, config, clock):
        self.config = config
        self.scale = FocusScale(config.table) if config.table else None
        self.connected = False
        self.model = self.description = ""  # of the camera, for people
        self._camera = RetryingCamera(camera, config.patience_s)
        self._photographer = Photographer(self._camera, clock, config.frames, config.timeout_s,
                                          keep_files=config.keep_files)
        self._bracketer = None

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
            self._photographer.owed = False
            maker = self._maker_of(self.model)
            if self._bracketer is None or self._bracketer.drive.maker is not maker:
                self._bracketer = self._bracketer_for(maker)
            if self.config.home != CURRENT:
                self._bracketer.drive.go_to_stop(self.config.home == FAR)
            self._bracketer.restore([])
        except Exception:
            self.close()
            raise
        self.connected = True
        limit = "" if maker.tells_limit else " (which do not report their focus limit)"
        self.description = f"{self.model}, focused as {maker.name} cameras are{limit}"

    def _maker_of(self, model):
        names = [self.config.maker or model]
        if not self.config.maker and maker_of(model) is None:
            with contextlib.suppress(CameraError):
                names.append(str(self._camera.get_config("manufacturer").value))
        maker = maker_of(*names)
        if maker is None:
            makers = ", ".join(maker.name for maker in MAKERS)
            raise CameraError(NOT_SUPPORTED, f"'{model}'", "its focus cannot be driven from here, only that of "
                              f"{makers}: use image_folder_camera")
        return maker

    def _bracketer_for(self, maker):
        drive = FocusDrive(self._camera, maker, self.config.step_size, self.config.settle_s)
        hold = SettingsHold(self._camera, maker, self.config.white_balance, self.config.iso)
        return Bracketer(drive, hold, self._photographer, self.scale)

    def shoot(self, publish):
        """A bracket of equal steps; see Bracketer.shoot()."""
        self._restore()
        start = self._bracketer.drive.position + self.config.first
        positions = [start + index * self.config.step for index in range(self.config.count)]
        with self._watching():
            return self._bracketer.shoot(positions, publish)

    def shoot_planned(self, distances, publish):
        """A bracket at these distances (m), from near to far or from far to near; needs a table."""
        positions, warnings = planned_positions(distances, self.scale)
        self._restore()
        with self._watching():
            return warnings + self._bracketer.shoot(positions, publish)

    def check(self):
        """Raises CameraError if the camera is no longer there."""
        with self._watching():
            self._photographer.idle()
        self._restore()

    def _restore(self):
        """Restore what the last bracket could not, because the camera was busy, for example."""
        with self._watching():
            self._bracketer.restore([])

    def close(self):
        self.connected = False
        self._camera.close()
