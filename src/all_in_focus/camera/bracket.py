# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The frames of a focus bracket, one picture at a time."""
import contextlib
import posixpath
import time

from all_in_focus.camera.interface import CAMERA_ERROR, CORRUPTED, CameraError
from all_in_focus.files.stack import IMAGE_SUFFIXES, decode_image

STILL, PREVIEW = "still", "preview"
STALE_PREVIEWS = 1  # live view frames that may have been exposed before the lens came to rest
QUEUE_EMPTY = 0.02  # s without an event after which the camera's queue counts as empty
LATE_COPIES = 20  # frames after which a copy still counts as one; later a camera may have started a new folder
LONGEST_DRAIN = 2.0  # s, for cameras that report events all the time


class Photographer:
    """Takes single pictures with an open camera. clock: gives the stamps.

    A picture belongs to a shot by the order of the camera's events: it is the first new one after the release. Pictures
    that are reported before the release were taken by hand or came late. A picture with the name of a frame in another
    folder is its copy on a second card. Both are left out; take_warnings() names them.
    """

    def __init__(self, camera, clock, frames=STILL, timeout=10.0, keep_files=True):
        self._camera, self._clock, self._frames = camera, clock, frames
        self._timeout, self._keep = timeout, keep_files
        self._paths = {}  # name -> path of the last frames
        self._left_out = {}  # reason -> names of pictures
        self._owed = False  # a picture timed out; if it arrives after all, it must not be taken for the next one

    def take(self, on_release):
        """The picture. on_release(stamp) is called as soon as the shutter is released (live view: just before the frame
        is requested)."""
        if self._frames == PREVIEW:
            for _ in range(STALE_PREVIEWS):
                self._camera.capture_preview()
            on_release(self._clock())
            return _decoded(self._camera.capture_preview(), "live view")
        if self._owed:
            with contextlib.suppress(CameraError):
                self._leave_out(self._await_picture())
            self._owed = False
        self.drain()
        stamps = []
        self._camera.capture(lambda: stamps.append(self._clock()))
        on_release(stamps[-1])
        path = self._await_picture()
        self._paths[posixpath.basename(path)] = path
        if len(self._paths) > LATE_COPIES:
            del self._paths[next(iter(self._paths))]
        image = _decoded(self._camera.download(path), path)
        if not self._keep:
            self._camera.delete(path)
        return image

    def drain(self):
        """Read the events that the camera has in its queue. Between brackets this also keeps the camera awake."""
        end = time.monotonic() + LONGEST_DRAIN
        while time.monotonic() < end:
            path = self._camera.wait_for_event(QUEUE_EMPTY)
            if path is None:
                return
            if _is_picture(path):
                self._leave_out(path)

    def reset(self):
        """The camera was opened anew: it reports no pictures from before, and may have another card."""
        self._owed = False
        self._paths.clear()

    def take_warnings(self):
        """Lines about the pictures that were left out since the last call."""
        lines = [f"left out {', '.join(names[:3])}{f' and {len(names) - 3} more' if len(names) > 3 else ''}: {reason}"
                 for reason, names in self._left_out.items()]
        self._left_out = {}
        return lines

    def _await_picture(self):
        """Path of the next new picture; raw files beside it stay on the card."""
        end, others = time.monotonic() + self._timeout, []
        while time.monotonic() < end:
            path = self._camera.wait_for_event(0.5) or ""
            if _is_picture(path):
                if not self._is_copy(path):
                    return path
                self._leave_out(path)
            elif path:
                others.append(posixpath.basename(path))
        self._owed = not others
        hint = f"only {', '.join(others)}: let the camera write JPEG" if others else "is a card in the camera?"
        raise CameraError(CAMERA_ERROR, "waiting for the picture", f"none came in {self._timeout:g} s, {hint}")

    def _is_copy(self, path):
        return self._paths.get(posixpath.basename(path), path) != path

    def _leave_out(self, path):
        is_copy = self._is_copy(path)
        reason = "a copy of a frame on another card" if is_copy else "taken by hand, or too late for its frame"
        self._left_out.setdefault(reason, []).append(posixpath.basename(path))
        self._owed &= is_copy


def _is_picture(path):
    return path.lower().endswith(IMAGE_SUFFIXES)


def _decoded(data, name):
    image = decode_image(data)
    if image is None:
        raise CameraError(CORRUPTED, f"reading {name}", "it is not a picture")
    return image
