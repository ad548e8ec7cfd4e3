# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures that come into a folder one by one, and the focus brackets that they make."""
import contextlib
import os
import time
from dataclasses import dataclass

from all_in_focus.files.stack import StackError, is_image_name, read_image


@dataclass
class Arrival:
    """A picture: BGR; name: of its file; stamp: when it was first seen."""
    image: object
    name: str
    stamp: object


class FolderWatch:
    """New and overwritten pictures of a folder; what lay there before does not count.

    clock: gives the stamps. A file is read when it no longer grows and is complete; one that stays damaged for
    `patience` seconds is given up, with a line in `warnings`.
    """

    def __init__(self, folder, clock, patience=5.0):
        self._folder, self._clock, self._patience = folder, clock, patience
        self._done = self._states()  # name -> state that is dealt with
        self._coming = {}  # name -> state, stamp, time of the last change
        self.warnings = []

    def _states(self):
        """Size and time of every picture. Raises StackError if the folder is not there."""
        states = {}
        try:
            names = os.listdir(self._folder)
        except OSError as error:
            raise StackError("%s: %s" % (self._folder, error.strerror))
        for name in names:
            if is_image_name(name):
                with contextlib.suppress(OSError):  # gone since it was listed
                    status = os.stat(os.path.join(self._folder, name))
                    states[name] = (status.st_size, status.st_mtime_ns)
        return states

    def poll(self):
        """Arrivals since the last call, in the order of their stamps, then names."""
        arrived = []
        for name, state in sorted(self._states().items()):
            if self._done.get(name) == state:
                continue
            coming = self._coming.get(name)
            if coming is None or coming[0] != state:
                stamp = coming[1] if coming else self._clock()
                self._coming[name] = (state, stamp, time.monotonic())
                continue
            arrival = self._read(name, *coming)
            if arrival:
                arrived.append(arrival)
        return sorted(arrived, key=lambda arrival: arrival.stamp)

    def _read(self, name, state, stamp, changed_at):
        path = os.path.join(self._folder, name)
        try:
            image = read_image(path)
        except StackError as error:
            if time.monotonic() - changed_at < self._patience:
                return None
            self.warnings.append("%s; left out" % error)
            image = None
        self._done[name] = state
        del self._coming[name]
        return None if image is None else Arrival(image, name, stamp)


class BracketGrouper:
    """Says which frame of which bracket an arrival is. Brackets have `size` frames; size 0: they end when nothing has
    come for `gap` seconds. Then the newest frame is held back until it is known whether it is the last."""

    def __init__(self, size=0, gap=2.0):
        self._size, self._gap = size, gap
        self._bracket_id, self._index = 0, 0
        self._held, self._held_since = None, 0.0

    def add(self, frame):
        """[(frame, bracket_id, index, count, last), ...] that can go out; count 0 = not known yet."""
        if self._size:
            return [self._out(frame, self._size, self._index + 1 == self._size)]
        ready = self._release(False)
        self._held, self._held_since = frame, time.monotonic()
        return ready

    def tick(self):
        """The same when nothing has come."""
        if self._held is None or time.monotonic() - self._held_since < self._gap:
            return []
        return self._release(True)

    def _release(self, last):
        if self._held is None:
            return []
        frame, self._held = self._held, None
        return [self._out(frame, self._index + 1 if last else 0, last)]

    def _out(self, frame, count, last):
        out = (frame, self._bracket_id, self._index, count, last)
        self._index += 1
        if last:
            self._bracket_id, self._index = self._bracket_id + 1, 0
        return out
