# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixes exposure, white balance and autofocus during a bracket, and restores them and the focus afterwards."""
import math
from fractions import Fraction
from functools import partial

from all_in_focus.camera.interface import NOT_SUPPORTED, CameraError, find_widget

MODES = ("autoexposuremode", "expprogram")
# The values that the camera has metered: read before the exposure mode changes, and set again in the new mode.
SHUTTER = ("shutterspeed", "shutterspeed2")
EXPOSURE = SHUTTER + ("aperture", "f-number")
# Where the camera would choose by itself, the first of these that it has is set.
WHITE_BALANCE = ("Daylight", "Sunny", "Direct sunlight", "Sunlight", "Fluorescent", "Tungsten")
ISO = ("400", "200", "800", "100")
NEAR_ENOUGH = 1.5  # factor between the exposure time that is wanted and the one that the camera has


class SettingsHold:
    """hold() fixes the settings, restore() restores them. warn(): gets a line for each that the camera refuses.

    holds: settings besides white balance, ISO and exposure; see Maker.holds.
    """

    def __init__(self, camera, holds, warn, white_balance="", iso=""):
        self._camera, self._holds, self._warn = camera, holds, warn
        self._chosen = {"whitebalance": (white_balance,) if white_balance else WHITE_BALANCE, "iso": (iso,) if iso else ISO}
        self._changed = {}  # name -> (function that restores it, the warning where it cannot), in the order of the changes

    def hold(self):
        """Raises CameraError only if the camera is lost."""
        metered = [(name, find_widget(self._camera, name)) for name in EXPOSURE]
        unknown = next((name for name, widget in metered if widget is not None and _is_automatic(widget.value)), None)
        for name, values in (*self._holds, *self._chosen.items()):
            self._take(name, values, unknown if name in MODES else None)
        for name, before in metered:
            now = find_widget(self._camera, name)
            if before is not None and now is not None and now.value != before.value and before.value in now.choices:
                self._set(name, before.value, now.value)

    def hold_focus(self, drive):
        """restore() begins with the focus, and tries twice: some lenses move only as long as the settings hold."""
        def restore(start=drive.position):
            try:
                drive.move_to(start)
            except CameraError as error:
                if error.busy or error.lost:
                    raise
                drive.move_to(start)
        self._changed["focus"] = (restore, "the focus is not back at its start position")

    def shutter_choices(self, seconds):
        """What expose() takes for each of these exposure times. CameraError where the camera has none that is near enough."""
        for name in SHUTTER if seconds else ():
            widget = find_widget(self._camera, name)
            times = {choice: _seconds_of(choice) for choice in widget.choices} if widget else {}
            times = {choice: time for choice, time in times.items() if time > 0}
            if times and not widget.read_only:
                return [(name, _nearest(times, wanted)) for wanted in seconds]
        if seconds:
            raise CameraError(NOT_SUPPORTED, "setting the exposure time", "no 'shutterspeed' that can be set from here")
        return []

    def expose(self, choice):
        """choice: of shutter_choices(); until restore()."""
        name, value = choice
        before = self._camera.get_config(name).value
        if value != before and not self._set(name, value, before):
            raise CameraError(NOT_SUPPORTED, f"setting '{name}' to {value}", "switch the camera to M")

    def restore(self):
        """Restores what has changed, the last change first.

        What the camera refuses is tried again after the others, because choices may depend on them (ISO 'Auto' on the
        exposure mode), and then given up with a warning. If the camera is busy or lost, it goes on with the others and
        raises the first such error at the end; the next call tries those again.
        """
        later, refused = {}, self._changed
        for last_try in (False, True):
            pending, refused = refused, {}
            for name, (restore, warning) in reversed(list(pending.items())):
                try:
                    restore()
                except CameraError as error:
                    if error.busy or error.lost:
                        later[name] = error
                    elif last_try:
                        self._warn(f"{warning} ({error})")
                    else:
                        refused = {name: (restore, warning), **refused}
        self._changed = {name: change for name, change in self._changed.items() if name in later}
        for error in later.values():
            raise error

    def _take(self, name, values, unknown):
        """Sets the first of the values that the camera has. unknown: an exposure that it has metered and does not report,
        without which the pictures could have any exposure in manual mode."""
        widget = find_widget(self._camera, name)
        if widget is None or str(widget.value) in values or name in self._chosen and not _is_automatic(widget.value):
            return
        wanted, problem = next((value for value in values if value in widget.choices), None), ""
        if unknown:
            problem = f"the camera does not report the '{unknown}' that it has metered: set it to manual yourself"
        elif wanted is None or widget.read_only or not self._set(name, wanted, widget.value):
            problem = f"cannot be set to {wanted or ' or '.join(values)} from here: set it on the camera"
        if problem:
            self._warn(f"'{name}' is '{widget.value}' and {problem}, or the frames of a bracket may differ")

    def _set(self, name, value, before):
        try:
            self._camera.set_config(name, value)
        except CameraError as error:
            if error.lost:
                raise
            return False
        restore = partial(self._camera.set_config, name, before)
        self._changed.setdefault(name, (restore, f"'{name}' was '{before}' and cannot be set back: set it on the camera"))
        return True


def _seconds_of(choice):
    """Of 1/125, 0.0080s or 2; 0 of Bulb and the like."""
    try:
        return float(Fraction(str(choice).rstrip("s\"'")))
    except (ValueError, ZeroDivisionError):
        return 0.0


def _nearest(times, wanted):
    def factor(choice):
        return abs(math.log(times[choice] / wanted))
    choice = min(times, key=factor)
    if factor(choice) > math.log(NEAR_ENOUGH):
        raise CameraError(NOT_SUPPORTED, f"an exposure of {wanted:g} s", f"the nearest that it has is {times[choice]:g} s")
    return choice


def _is_automatic(value):
    return str(value).lower().startswith(("auto", "awb"))
