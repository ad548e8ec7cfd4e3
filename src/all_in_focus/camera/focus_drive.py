# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Moves the focus by whole steps, and keeps count of the position."""
import math
import time

from all_in_focus.camera.interface import BAD_PARAMETERS, CAMERA_ERROR, CameraError, find_widget
from all_in_focus.camera.makers import CHOICES, HAND, POSITION

READ_BACK = 5.0  # s that the lens may take to reach an absolute position
TO_STOP = 30  # moves of the greatest size that are enough to reach the end of any lens's range


class FocusLimit(CameraError):
    """The focus is at the end of its range; the message says which end."""

    def __init__(self, far):
        super().__init__(CAMERA_ERROR)
        self.args = (f"the focus is at its {'far' if far else 'near'} limit",)


class FocusDrive:
    """Focus of one camera. position: in steps, + is far, 0 = where the focus was when the drive was made.

    size: of one step, in the maker's unit; 0 = typical of the maker; settle_s: < 0 = typical. A camera that does not report
    its limit goes on counting although its lens has stopped: start far enough from the limit.
    """

    def __init__(self, camera, maker, size=0, settle_s=-1.0):
        self.maker, self.size = maker, size or maker.typical
        smallest, greatest = maker.sizes
        if not smallest <= self.size <= greatest:
            raise CameraError(BAD_PARAMETERS, f"step_size {self.size}", f"{maker.name} cameras take {smallest} to {greatest}")
        self.position = 0
        self._camera = camera
        self._settle = settle_s if settle_s >= 0 else maker.settle_s
        found = (find_widget(self._camera, name) for name in maker.widgets)
        self._widget = next((widget for widget in found if widget is not None and not widget.read_only), None)
        if self._widget is None and maker.rule != HAND:
            raise CameraError(BAD_PARAMETERS, "looking for the focus drive",
                              f"no widget {' or '.join(maker.widgets)}: is the lens in the mode in which the camera can move it?")
        self._zero = self._absolute(self._widget.value) if maker.rule == POSITION else 0

    def _absolute(self, value):
        """The value of the widget as a number; some cameras give it as a text."""
        try:
            return float(value)
        except (TypeError, ValueError):
            raise CameraError(BAD_PARAMETERS, "reading the focus position", f"'{value}' is not a position")

    def move_to(self, position):
        """Drive to this position. Raises FocusLimit at the end of the range; `position` is then the one reached."""
        steps = position - self.position
        if steps == 0:
            return
        if self.maker.rule == HAND:
            time.sleep(self._settle if steps > 0 else 0)
            self.position = position
            return
        self.wake()
        if self.maker.rule == POSITION:
            self._go(position)
            return
        for _ in range(abs(steps)):
            self._command(steps > 0, self.size)
            self.position += 1 if steps > 0 else -1

    def wake(self):
        """Switch live view on where the drive needs it: taking a picture may have ended it."""
        if self.maker.live_view and self._camera.get_config("viewfinder").value != 1:
            self._camera.set_config("viewfinder", 1)

    def go_to_stop(self, far=False):
        """Drive to the end of the range with the greatest steps, and count from there.

        A camera that does not report its limit gets TO_STOP steps.
        """
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
        """Make one relative move and wait until the lens is at rest."""
        name = self._widget.name
        try:
            if self.maker.rule == CHOICES:
                self._camera.set_config(name, "None")  # first: if it fails, nothing has moved
                self._camera.set_config(name, f"{'Far' if far else 'Near'} {size}")
            else:
                self._camera.set_config(name, size if far else -size)
        except CameraError as error:
            if error.at_limit:
                raise FocusLimit(far)
            raise
        time.sleep(self._settle)

    def _go(self, position):
        """Make an absolute move, as far as the range allows: to a whole step, so that the way back is whole steps."""
        low, high, reachable = self._widget.low, self._widget.high, position
        if low is not None:
            reachable = max(reachable, math.ceil((low - self._zero) / self.size))
        if high is not None:
            reachable = min(reachable, math.floor((high - self._zero) / self.size))
        self._drive(reachable)
        if reachable != position:
            raise FocusLimit(position > reachable)

    def _drive(self, position):
        """Set the absolute position and wait until the lens reports it."""
        wanted = round(self._zero + position * self.size)
        self._camera.set_config(self._widget.name, wanted)
        self.position = position
        end = time.monotonic() + READ_BACK
        while abs(self._absolute(self._camera.get_config(self._widget.name).value) - wanted) > 0.5:
            if time.monotonic() > end:
                raise CameraError(CAMERA_ERROR, f"driving the focus to {wanted:g}", "the lens does not get there")
            time.sleep(0.05)
        time.sleep(self._settle)
