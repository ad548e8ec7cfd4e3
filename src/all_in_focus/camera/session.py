# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One camera over time: found, opened, lost, found again; and what it shoots."""
import contextlib
from dataclasses import dataclass

from all_in_focus.camera.bracket import STILL, Bracketer, Photographer, planned_positions
from all_in_focus.camera.focus_drive import FocusDrive
from all_in_focus.camera.focus_scale import FocusScale
from all_in_focus.camera.interface import NOT_SUPPORTED, CameraError
from all_in_focus.camera.makers import MAKERS, maker_of
from all_in_focus.camera.patience import PatientCamera
from all_in_focus.camera.settings_hold import SettingsHold

CURRENT, NEAR, FAR = "current", "near", "far"


@dataclass
class Config:
    """maker: a name of the table, "" = by the camera's own; count, step, first: a bracket's frames, the steps between
    them (+ is far) and from the start position to the first; step_size: 0 = the maker's; settle_s: None = the maker's;
    home: where position 0 is: the focus at the start, or a stop; table: of FocusScale, empty = not calibrated."""
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
    """clock: gives the stamps of the frames. All calls but close() may raise CameraError; one that has lost the camera
    leaves `connected` false."""

    def __init__(self, camera, config, clock):
        self.config = config
        self.scale = FocusScale(config.table) if config.table else None
        self.connected = False
        self.model = self.description = ""  # of the camera, for people
        self._camera = PatientCamera(camera, config.patience_s)
        self._photographer = Photographer(self._camera, clock, config.frames, config.timeout_s,
                                          keep_files=config.keep_files)
        self._bracketer = None

    @contextlib.contextmanager
    def _watching(self):
        try:
            yield
        except CameraError as error:
            if error.lost:
                self.close()
            raise

    def connect(self):
        """Open the camera, and put back what an interrupted bracket has left."""
        try:
            self.model = self._camera.open()
            self._photographer.owed = False
            maker = self._maker_of(self.model)
            if self._bracketer is None or self._bracketer.drive.maker is not maker:
                self._bracketer = self._prepared(maker)
            if self.config.home != CURRENT:
                self._bracketer.drive.go_to_stop(self.config.home == FAR)
            self._bracketer.restore([])
        except Exception:
            self.close()
            raise
        self.connected = True
        self.description = "%s, focused as %s cameras are%s" % (
            self.model, maker.name, "" if maker.tells_limit else " (which do not tell their focus limit)")

    def _maker_of(self, model):
        names = [self.config.maker or model]
        if not self.config.maker and maker_of(model) is None:
            with contextlib.suppress(CameraError):
                names.append(str(self._camera.get_config("manufacturer").value))
        maker = maker_of(*names)
        if maker is None:
            raise CameraError(NOT_SUPPORTED, "'%s'" % model, "its focus cannot be driven from here, only that of "
                              "%s: use image_folder_camera" % ", ".join(maker.name for maker in MAKERS))
        return maker

    def _prepared(self, maker):
        drive = FocusDrive(self._camera, maker, self.config.step_size, self.config.settle_s)
        hold = SettingsHold(self._camera, maker, self.config.white_balance, self.config.iso)
        return Bracketer(drive, hold, self._photographer, self.scale)

    def shoot(self, publish):
        """A bracket of equal steps; see Bracketer.shoot()."""
        self._put_right()
        start = self._bracketer.drive.position + self.config.first
        positions = [start + index * self.config.step for index in range(self.config.count)]
        with self._watching():
            return self._bracketer.shoot(positions, publish)

    def shoot_planned(self, distances, publish):
        """A bracket at these distances (m), near to far or the other way; needs a table."""
        positions, remarks = planned_positions(distances, self.scale)
        self._put_right()
        with self._watching():
            return remarks + self._bracketer.shoot(positions, publish)

    def check(self):
        """Whether it is still there."""
        with self._watching():
            self._photographer.idle()
        self._put_right()

    def _put_right(self):
        """What a bracket has left whose way back failed, too: the camera was busy, say."""
        with self._watching():
            self._bracketer.restore([])

    def close(self):
        self.connected = False
        self._camera.close()
