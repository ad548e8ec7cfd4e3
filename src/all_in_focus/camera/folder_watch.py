# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Finds pictures that arrive in a folder one by one, and groups them into focus brackets."""
import contextlib
import math
import time
from collections import namedtuple
from pathlib import Path

from all_in_focus.camera.frame_publisher import Frame
from all_in_focus.files.stack import StackError, is_image_name, read_pages


# A picture: BGR; name: of its file or page; stamp: when the file was first seen.
Arrival = namedtuple("Arrival", "image name stamp")


def _state(path):
    """Size and time of change of a file."""
    status = path.stat()
    return status.st_size, status.st_mtime_ns


class FolderWatch:
    """New and overwritten pictures of a folder. Files that are there at the beginning are not reported.

    clock: gives the stamps. A file is read when it has stopped growing and is complete. One that stays damaged for
    `patience` seconds is left out, with a line in `warnings`; and so is what comes if none of it is a picture.
    """

    def __init__(self, folder, clock, patience=5.0):
        self._folder, self._clock, self._patience = Path(folder), clock, patience
        self._done = self._states()  # name -> state of the file when it was reported or left out
        self._coming = {}  # name -> state, stamp, time of the last change
        self._may_miss_pictures = True
        self.warnings = []

    def _states(self):
        """Name -> state of all files but hidden ones. Raises StackError if the folder is not there."""
        states = {}
        try:
            for path in self._folder.iterdir():
                if not path.name.startswith("."):
                    with contextlib.suppress(OSError):  # it has been deleted
                        states[path.name] = _state(path)
        except OSError as error:
            raise StackError(f"{self._folder}: {error.strerror}")
        return states

    def poll(self):
        """Arrivals since the last call, in the order of their stamps, then names."""
        arrived, states = [], self._states()
        self._coming = {name: coming for name, coming in self._coming.items() if name in states}
        for name, state in sorted(states.items()):
            before, stamp, changed_at = self._coming.get(name, (None, None, 0.0))
            if self._done.get(name) == state:
                continue
            if before != state:
                self._coming[name] = (state, self._clock() if before is None else stamp, time.monotonic())
                self._may_miss_pictures &= not is_image_name(name)
            elif is_image_name(name):
                arrived += self._read(name, state, stamp, changed_at)
            elif self._may_miss_pictures and time.monotonic() - changed_at > self._patience:
                self._may_miss_pictures = False
                self.warnings.append(f"{self._folder}: {name} came, and no picture: let the camera write JPEG, too; raw "
                                     "files are not read here")
        return sorted(arrived, key=lambda arrival: arrival.stamp)

    def _read(self, name, state, stamp, changed_at):
        try:
            images, damage = read_pages(str(self._folder / name)), []
        except StackError as error:
            images, damage = [], [f"{error}; left out"]
        try:
            was_written_to = _state(self._folder / name) != state
        except OSError:
            was_written_to = True
        may_become_whole = damage and time.monotonic() - changed_at < self._patience
        if was_written_to or may_become_whole:
            return []
        self.warnings += damage
        self._done[name] = state
        del self._coming[name]
        return [Arrival(image, page, stamp) for page, image in images]


class BracketGrouper:
    """Makes frames of the arrivals, numbered by bracket and index.

    A bracket has `size` frames. With size 0 it ends when nothing has arrived for `gap` seconds; then the newest frame is
    held back until it is known whether it is the last one. distance: function of name and index.
    """

    def __init__(self, size=0, gap=2.0, distance=lambda name, index: math.nan):
        self._size, self._gap, self._distance = size, gap, distance
        self._bracket_id, self._index = 0, 0
        self._held, self._held_since = None, 0.0

    def after(self, arrival=None):
        """The Frame that can be published after an arrival, or when nothing has arrived; None: there is none."""
        if self._size:
            ready, count, last = arrival, self._size, self._index + 1 == self._size
        elif arrival or time.monotonic() - self._held_since >= self._gap:
            ready, last = self._held, arrival is None
            count = self._index + 1 if last else 0  # not known yet
            self._held, self._held_since = arrival, time.monotonic()
        else:
            return None
        if ready is None:
            return None
        distance = self._distance(ready.name, self._index)
        frame = Frame(self._index, count, last, distance, self._bracket_id, ready.stamp, ready.image)
        self._bracket_id, self._index = (self._bracket_id + 1, 0) if last else (self._bracket_id, self._index + 1)
        return frame
