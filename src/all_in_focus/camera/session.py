# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One camera over time: connects, shoots brackets with fixed settings, restores focus and settings, reconnects after it was
lost."""
import contextlib
import math

from all_in_focus.camera.bracket import Photographer, Shot
from all_in_focus.camera.focus_drive import FocusDrive, FocusLimit, RingDrive
from all_in_focus.camera.interface import NOT_SUPPORTED, CameraError, RetryingCamera
from all_in_focus.camera.makers import ALL_HOLDS, MAKERS, maker_of
from all_in_focus.camera.settings_hold import SettingsHold
from all_in_focus.files.focus_table import FocusTable
from all_in_focus.imaging import FocusCheck

CURRENT, NEAR, FAR = "current", "near", "far"
MOTOR, NONE = "motor", "none"
RING_PAUSE = 1.0  # s, default time to turn the focus ring between two frames


class Session:
    """settings: values of bracket_node.PARAMETERS; clock: gives the stamps of the frames. All calls but close() may raise
    CameraError. One that loses the camera sets `connected` to false. After each call take_warnings() returns its warnings."""

    def __init__(self, camera, settings, clock):
        self._settings = settings
        self.scale = FocusTable(settings.focus_table) if settings.focus_table else None
        self.connected = False
        self.model = self.description = ""  # of the camera, for people
        self._camera = RetryingCamera(camera, settings.patience)
        self._photographer = Photographer(self._camera, clock, settings.frames, settings.timeout, settings.keep_files)
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
                settings = self._settings
                if settings.drive == NONE:
                    self._drive = RingDrive(settings.settle if settings.settle >= 0 else RING_PAUSE)
                else:
                    self._drive = FocusDrive(self._camera, maker, settings.step_size,
                                             settings.settle if settings.settle >= 0 else None)
                self._hold = SettingsHold(self._camera, maker.holds if maker else ALL_HOLDS, settings.white_balance,
                                          settings.iso)
                self._maker, self._start = maker, None
            home = self._settings.home or (NEAR if self.scale else CURRENT)
            if home != CURRENT:
                self._drive.go_to_stop(home == FAR)
            self._restore()
        except Exception:
            self.close()
            raise
        self.connected = True
        if self._settings.drive == NONE:
            self.description = f"{self.model}, focused by hand"
        else:
            limit = "" if maker.reports_limit else " (which do not report their focus limit)"
            self.description = f"{self.model}, focused as {maker.name} cameras are{limit}"

    def _maker_of(self, model):
        names = [self._settings.maker or model]
        if not self._settings.maker and maker_of(model) is None:
            with contextlib.suppress(CameraError):
                names.append(str(self._camera.get_config("manufacturer").value))
        maker = maker_of(*names)
        if maker is None and self._settings.drive != NONE:
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
        settings, self._start = self._settings, self._drive.position
        first, step = (0, 1) if settings.drive == NONE else (settings.first, settings.step)
        positions = [self._start + first + index * step for index in range(settings.count)]
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
