# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One camera over time: connects, shoots brackets with fixed settings, restores focus and settings, reconnects after it was
lost."""
import contextlib
import math

from all_in_focus.camera.bracket import Photographer
from all_in_focus.camera.focus_drive import FocusDrive, FocusLimit
from all_in_focus.camera.frame_publisher import Frame
from all_in_focus.camera.interface import NOT_SUPPORTED, CameraError, RetryingCamera
from all_in_focus.camera.makers import HAND, MAKERS, by_hand, maker_of
from all_in_focus.camera.settings_hold import SettingsHold
from all_in_focus.files.focus_table import FocusTable
from all_in_focus.imaging import FocusCheck

CURRENT, NEAR, FAR = "current", "near", "far"
MOTOR, NONE = "motor", "none"


class Session:
    """settings: values of bracket_node.PARAMETERS; clock: gives the stamps of the frames. All calls but close() may raise
    CameraError. One that loses the camera sets `connected` to false. After each call take_warnings() returns its warnings."""

    def __init__(self, camera, settings, clock):
        self._settings = settings
        self.scale = FocusTable(settings.focus_table) if settings.focus_table else None
        self.model = self.description = ""  # of the camera, for people
        self._camera = RetryingCamera(camera, settings.patience)
        self._photographer = Photographer(self._camera, clock, settings.frames, settings.timeout, settings.keep_files)
        self._maker = self._drive = self._hold = None  # as long as no camera was there
        self._warnings = []

    @property
    def connected(self):
        return self._camera.connected

    def connect(self):
        """Open the camera, and restore what an interrupted bracket has left changed."""
        try:
            self.model = self._camera.open()
            self._photographer.reset()
            maker = self._maker_of(self.model)
            if self._maker != maker:
                settings = self._settings
                self._drive = FocusDrive(self._camera, maker, settings.step_size, settings.settle)
                self._hold = SettingsHold(self._camera, maker.holds, self._warnings.append, settings.white_balance, settings.iso)
                self._maker = maker
            home = self._settings.home or (NEAR if self.scale else CURRENT)
            if home != CURRENT:
                self._drive.go_to_stop(home == FAR)
            self._hold.restore()
        except Exception:
            self.close()
            raise
        self._camera.connected = True
        limit = "" if maker.reports_limit else " (which do not report their focus limit)"
        how = "by hand" if maker.rule == HAND else f"as {maker.name} cameras are{limit}"
        self.description = f"{self.model}, focused {how}"

    def _maker_of(self, model):
        names = [self._settings.maker or model]
        if not self._settings.maker and maker_of(model) is None:
            with contextlib.suppress(CameraError):
                names.append(str(self._camera.get_config("manufacturer").value))
        maker = maker_of(*names)
        if self._settings.drive == NONE:
            return by_hand(maker)
        if maker is None:
            makers = ", ".join(maker.name for maker in MAKERS)
            raise CameraError(NOT_SUPPORTED, f"'{model}'", "its focus cannot be driven from here, only that of "
                              f"{makers}: use image_folder_camera, or ~drive:=none and turn the focus ring by hand")
        return maker

    def shoot(self, publish, on_release=lambda shot: None, exposures=(), distances=()):
        """A bracket of equal steps, or, with a table, at these distances (m), from near to far or from far to near; of frames
        that are alike in position and exposure only the first is taken then. exposures: times in s, one for all frames or one
        for each; empty: as metered.

        on_release(Frame): at the release, before the picture is downloaded; publish(Frame): with the picture. Between the
        two, count and last change if the bracket has to end with this frame.

        At the end of the focus range the bracket ends early, with a warning; it raises FocusLimit if not even the first
        frame can be reached. Focus and settings are restored afterwards, also after an error; by the next call if the
        camera is busy or lost.
        """
        self._hold.restore()
        first, step = (0, 1) if self._maker.rule == HAND else (self._settings.first, self._settings.step)
        positions = [self._drive.position + first + index * step for index in range(self._settings.count)]
        for distance in distances:
            if not self.scale.reaches(distance):
                self._warnings.append(f"{distance:.2f} m lies beyond the focus table: focused at its end")
        if len(distances):
            positions = list(map(self.scale.nearest_step, distances))
        try:
            self._hold.hold()
            self._hold.hold_focus(self._drive)
            choices = self._hold.shutter_choices(exposures) or [None]
            plan = list(zip(positions, choices * len(positions) if len(choices) == 1 else choices))
            self._sweep(list(dict.fromkeys(plan)) if len(distances) else plan, publish, on_release)
        except BaseException:
            with contextlib.suppress(CameraError):  # report the first error, not this one
                self._hold.restore()
            raise
        self._hold.restore()

    def _sweep(self, plan, publish, on_release):
        """plan: of each frame position and choice of the shutter, None: as metered."""
        def prepare(index):
            position, choice = plan[index]
            self._drive.move_to(position)
            if choice:
                self._hold.expose(choice)
        prepare(0)
        count, focus = len(plan), FocusCheck()
        for index in range(len(plan)):
            self._drive.wake()
            distance = self.scale.distance(self._drive.position) if self.scale else math.nan
            frame = Frame(index, count, index + 1 == count, distance)

            def released(stamp, frame=frame):
                frame.stamp = stamp
                on_release(frame)
            frame.image = self._photographer.take(released)
            focus.add(frame.image)
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
            frame.count, frame.last = count, index + 1 == count
            publish(frame)
            if failure:
                raise failure
            if frame.last:
                break
        if focus.stood_still:
            remedy = ("turn the focus ring further between the frames" if self._maker.rule == HAND else
                      "check the AF/MF switch of the lens (docs/dslr.md: makers), or take larger steps")
            self._warnings.append(f"the focus did not move: the sharpness changed by {100 * focus.change:.0f} % at most over "
                                  f"{count} frames; {remedy}")

    def check(self):
        """Connects to the camera, or raises CameraError if it is no longer there."""
        if not self.connected:
            self.connect()
        self._photographer.drain()
        self._hold.restore()

    def take_warnings(self):
        """Warnings since the last call, one line each."""
        warnings = self._warnings + self._photographer.take_warnings()
        self._warnings.clear()
        return warnings

    def close(self):
        self._camera.close()
