# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixes exposure, white balance and autofocus during a bracket, and restores them afterwards."""
import math
from fractions import Fraction

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
    """hold() fixes the settings, release() restores them. Both append to the list `warnings` what the camera refuses, one
    line each.

    holds: settings besides white balance, ISO and exposure; see Maker.holds.
    """

    def __init__(self, camera, holds, white_balance="", iso=""):
        self._camera = camera
        self._holds = dict(holds)
        self._fixed = {"whitebalance": (white_balance,) if white_balance else WHITE_BALANCE,
                       "iso": (str(iso),) if iso else ISO}
        self._changed = []  # (name, value before), in the order of the changes

    def hold(self, warnings):
        """Raises CameraError only if the camera is lost."""
        metered = [(name, find_widget(self._camera, name)) for name in EXPOSURE]
        unknown = [name for name, widget in metered if widget is not None and _is_automatic(widget.value)]
        for name, values in self._holds.items():
            if unknown and name in MODES:
                self._warn_of_unknown_exposure(name, values, unknown[0], warnings)
                continue
            self._take(name, values, "the exposure or the focus may change within the bracket", warnings)
        for name, values in self._fixed.items():
            widget = find_widget(self._camera, name)
            if widget is not None and _is_automatic(widget.value):
                self._take(name, values, "it may change within the bracket", warnings)
        for name, before in metered:
            now = find_widget(self._camera, name)
            if before is not None and now is not None and now.value != before.value and before.value in now.choices:
                self._set(name, before.value, now.value)

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
        """choice: of shutter_choices(); until release()."""
        name, value = choice
        before = find_widget(self._camera, name).value
        if value != before and not self._set(name, value, before):
            raise CameraError(NOT_SUPPORTED, f"setting '{name}' to {value}", "switch the camera to M")

    def release(self, warnings):
        """Restores the settings, the last change first.

        A setting that the camera refuses is tried again after the others, because its choices may depend on them (ISO
        'Auto' on the exposure mode), and then given up with a warning. If the camera is busy or lost, it goes on with the
        other settings and raises the first such error at the end; the next call tries those settings again.
        """
        first, later, refused = None, [], self._changed
        for last_try in (False, True):
            pending, refused = refused, []
            for name, value in reversed(pending):
                try:
                    self._camera.set_config(name, value)
                except CameraError as error:
                    if error.busy or error.lost:
                        later.insert(0, (name, value))
                        first = first or error
                    elif last_try:
                        warnings.append(f"'{name}' was '{value}' and cannot be set back: set it on the camera ({error})")
                    else:
                        refused.insert(0, (name, value))
        self._changed = later
        if first:
            raise first

    def _warn_of_unknown_exposure(self, name, values, unknown, warnings):
        """Manual mode is left alone: without the metered values the pictures could have any exposure."""
        widget = find_widget(self._camera, name)
        if widget is not None and str(widget.value) not in values:
            warnings.append(f"'{name}' is '{widget.value}' and the camera does not report the '{unknown}' that it has "
                            "metered: set it to manual yourself, the exposure may change within the bracket")

    def _take(self, name, values, consequence, warnings):
        widget = find_widget(self._camera, name)
        if widget is None or str(widget.value) in values:
            return
        wanted = next((value for value in values if value in widget.choices), None)
        if wanted is None or widget.read_only or not self._set(name, wanted, widget.value):
            warnings.append(f"'{name}' is '{widget.value}' and cannot be set to {wanted or ' or '.join(values)} from "
                            f"here: set it on the camera, {consequence}")

    def _set(self, name, value, before):
        try:
            self._camera.set_config(name, value)
        except CameraError as error:
            if error.lost:
                raise
            return False
        if name not in dict(self._changed):
            self._changed.append((name, before))
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
