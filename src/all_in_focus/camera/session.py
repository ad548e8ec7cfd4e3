# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One camera over time: connects, shoots brackets with fixed settings, restores focus and settings, reconnects after it was
lost."""
import contextlib
import math
from dataclasses import dataclass

from all_in_focus.camera.bracket import STILL, Photographer, Shot
from all_in_focus.camera.focus_drive import FocusDrive, FocusLimit, RingDrive
from all_in_focus.camera.interface import NOT_SUPPORTED, CameraError, RetryingCamera
from all_in_focus.camera.makers import ALL_HOLDS, MAKERS, maker_of
from all_in_focus.camera.settings_hold import SettingsHold
from all_in_focus.files.focus_table import FocusTable
from all_in_focus.imaging import FocusCheck

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
        self._maker = self._drive = self._hold = None  # as long as no camera was there
        self._start = None  # focus position before the bracket
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
            if self._drive is None or self._maker is not maker:
                config = self.config
                if config.drive == NONE:
                    self._drive = RingDrive(RING_PAUSE if config.settle_s is None else config.settle_s)
                else:
                    self._drive = FocusDrive(self._camera, maker, config.step_size, config.settle_s)
                self._hold = SettingsHold(self._camera, maker.holds if maker else ALL_HOLDS, config.white_balance, config.iso)
                self._maker, self._start = maker, None
            if self.config.home != CURRENT:
                self._drive.go_to_stop(self.config.home == FAR)
            self._restore()
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

    def shoot(self, publish, on_release=lambda shot: None, exposures=(), distances=()):
        """A bracket of equal steps, or, with a table, at these distances (m), from near to far or from far to near; of frames
        that are alike in position and exposure only the first is taken then. exposures: times in s, one for all frames or one
        for each; empty: as metered.

        on_release(Shot): at the release, before the picture is downloaded; publish(Shot): with the picture. Between the
        two, count and last change if the bracket has to end with this frame.

        At the end of the focus range the bracket ends early, with a warning; it raises FocusLimit if not even the first
        frame can be reached. Focus and settings are restored afterwards, also after an error; by the next call if the
        camera is busy or lost.
        """
        self._restore()
        config, self._start = self.config, self._drive.position
        first, step = (0, 1) if config.drive == NONE else (config.first, config.step)
        positions = [self._start + first + index * step for index in range(config.count)]
        if len(distances):
            for distance in distances:
                if not self.scale.reaches(distance):
                    self._warnings.append(f"{distance:.2f} m lies beyond the focus table: focused at its end")
            positions = list(map(self.scale.nearest_step, distances))
            if len(exposures) > 1:
                positions, exposures = zip(*dict.fromkeys(zip(positions, exposures)))
            else:
                positions = list(dict.fromkeys(positions))
        with self._watching():
            try:
                self._hold.hold(self._warnings)
                exposures = self._hold.shutter_choices(exposures)
                if len(exposures) == 1:
                    exposures *= len(positions)
                self._sweep(positions, exposures, publish, on_release)
            except BaseException:
                with contextlib.suppress(CameraError):  # report the first error, not this one
                    self._restore()
                raise
        self._restore()

    def _sweep(self, positions, exposures, publish, on_release):
        def prepare(index):
            self._drive.move_to(positions[index])
            if exposures:
                self._hold.expose(exposures[index])
        prepare(0)
        count, focus = len(positions), FocusCheck()
        for index in range(len(positions)):
            self._drive.wake()
            distance = self.scale.distance(self._drive.position) if self.scale else math.nan
            shot = Shot(None, self._drive.position, index, count, index + 1 == count, distance)

            def released(stamp, shot=shot):
                shot.stamp = stamp
                on_release(shot)
            shot.image = self._photographer.take(released)
            focus.add(shot.image)
            failure = None
            if index + 1 < count:
                # Move on before this frame is published: if the next position cannot be reached, this frame is the
                # last one and has to say so.
                try:
                    prepare(index + 1)
                except FocusLimit as limit:
                    self._warnings.append(f"{limit} after {index + 1} of {count} frames")
                    count = index + 1
                except CameraError as error:
                    failure, count = error, index + 1
            shot.count, shot.last = count, index + 1 == count
            publish(shot)
            if failure:
                raise failure
            if shot.last:
                break
        if focus.stood_still:
            self._warnings.append(f"the focus did not move: the sharpness changed by {100 * focus.change:.0f} % at most over "
                                  f"{count} frames; {self._drive.REMEDY}")

    def check(self):
        """Raises CameraError if the camera is no longer there."""
        with self._watching():
            self._photographer.drain()
        self._restore()

    def _restore(self):
        """Restore focus and settings as before the last bracket. Raises CameraError if the camera is busy or lost; then the
        next call goes on. What the camera refuses otherwise is given up with a warning."""
        with self._watching():
            try:
                if self._start is not None:
                    self._return_to_start()
                self._start = None
            finally:
                self._hold.release(self._warnings)

    def _return_to_start(self):
        for last_try in (False, True):
            try:
                return self._drive.move_to(self._start)
            except FocusLimit as limit:
                return self._warnings.append(f"{limit}: the start position is not reached")
            except CameraError as error:
                if error.busy or error.lost:
                    raise
                if last_try:
                    self._warnings.append(f"the focus is not back at its start position: {error}")

    def take_warnings(self):
        """Warnings since the last call, one line each."""
        warnings = self._warnings + self._photographer.take_warnings()
        self._warnings.clear()
        return warnings

    def close(self):
        self.connected = False
        self._camera.close()
