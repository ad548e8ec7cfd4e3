# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Moves the focus by whole steps and keeps count of where it is."""
import math
import time

from all_in_focus.camera.interface import BAD_PARAMETERS, CAMERA_ERROR, CameraError
from all_in_focus.camera.makers import CHOICES, POSITION

READ_BACK = 5.0  # s for a focus position to be reached
TO_STOP = 30  # moves of the greatest size, at most, to drive against a stop


class FocusLimit(Exception):
    """The focus is at the end of its range; the text says which."""

    def __init__(self, far):
        super().__init__("the focus is at its %s limit" % ("far" if far else "near"))


class FocusDrive:
    """Focus of one camera. position: in steps, + is far, 0 = where the focus was when the drive was made.

    size: of a step, in the maker's unit. Cameras that do not tell their limit go on being counted when they stand at
    it: start far enough from it.
    """

    def __init__(self, camera, maker, size=0, settle_s=None):
        self.maker, self.size = maker, size or maker.typical
        if not maker.sizes[0] <= self.size <= maker.sizes[1]:
            raise CameraError(BAD_PARAMETERS, "step_size %d" % self.size, "%s cameras take %d to %d"
                              % ((maker.name,) + maker.sizes))
        self.position = 0
        self._camera = camera
        self._settle = maker.settle_s if settle_s is None else settle_s
        self._widget = self._find()
        self._zero = self._absolute(self._widget.value) if maker.rule == POSITION else 0

    def _find(self):
        for name in self.maker.widgets:
            try:
                widget = self._camera.get_config(name)
            except CameraError as error:
                if error.lost:
                    raise
                continue
            if not widget.read_only:
                return widget
        raise CameraError(BAD_PARAMETERS, "looking for the focus drive", "no widget %s: is the lens in the mode in "
                          "which the camera can move it?" % " or ".join(self.maker.widgets))

    def _absolute(self, value):
        """A position as the widget gives it; texts are numbers too."""
        try:
            return float(value)
        except (TypeError, ValueError):
            raise CameraError(BAD_PARAMETERS, "reading the focus position", "'%s' is not a position" % value)

    def move_to(self, position):
        """Drive there; raises FocusLimit at the end of the range, and the position is what was reached."""
        steps = position - self.position
        if steps == 0:
            return
        self.wake()
        if self.maker.rule == POSITION:
            self._go(position)
            return
        for _ in range(abs(steps)):
            self._command(steps > 0, self.size)
            self.position += 1 if steps > 0 else -1

    def wake(self):
        """Live view on, where the drive needs it: taking a picture may have ended it."""
        if self.maker.live_view and self._camera.get_config("viewfinder").value != 1:
            self._camera.set_config("viewfinder", 1)

    def go_to_stop(self, far=False):
        """Drive against the end of the range with the greatest steps, and count from there. Cameras that do not tell
        their limit get TO_STOP of them."""
        self.wake()
        if self.maker.rule == POSITION:
            self._zero = self._absolute(self._widget.high if far else self._widget.low)
            self._drive(0)
        else:
            for _ in range(TO_STOP):
                try:
                    self._command(far, self.maker.sizes[1])
                except FocusLimit:
                    break
        self.position = 0

    def _command(self, far, size):
        """One relative move, finished when this returns."""
        name = self._widget.name
        try:
            if self.maker.rule == CHOICES:
                self._camera.set_config(name, "%s %d" % ("Far" if far else "Near", size))
                self._camera.set_config(name, "None")
            else:
                self._camera.set_config(name, size if far else -size)
        except CameraError as error:
            if error.at_limit:
                raise FocusLimit(far)
            raise
        time.sleep(self._settle)

    def _go(self, position):
        """An absolute move, as far as the range allows: to a whole step, so that the way back is whole steps too."""
        low, high, reachable = self._widget.low, self._widget.high, position
        if low is not None:
            reachable = max(reachable, math.ceil((low - self._zero) / self.size))
        if high is not None:
            reachable = min(reachable, math.floor((high - self._zero) / self.size))
        self._drive(reachable)
        if reachable != position:
            raise FocusLimit(position > reachable)

    def _drive(self, position):
        """To an absolute position, waiting until it is reached."""
        wanted = round(self._zero + position * self.size)
        self._camera.set_config(self._widget.name, wanted)
        end = time.monotonic() + READ_BACK
        while abs(self._absolute(self._camera.get_config(self._widget.name).value) - wanted) > 0.5:
            if time.monotonic() > end:
                raise CameraError(CAMERA_ERROR, "driving the focus to %g" % wanted, "it does not get there")
            time.sleep(0.05)
        self.position = position
        time.sleep(self._settle)
