# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shoots one focus bracket: hold the settings, focus, release, fetch, go back."""
import contextlib
import math
import posixpath
import time
from dataclasses import dataclass

import numpy as np

from all_in_focus.camera.focus_drive import FocusLimit
from all_in_focus.camera.interface import CAMERA_ERROR, CORRUPTED, CameraError
from all_in_focus.files.stack import IMAGE_SUFFIXES, decode_image

STILL, PREVIEW = "still", "preview"
STALE_PREVIEWS = 1  # begun before the lens came to rest


@dataclass
class Shot:
    """One frame of a bracket. image: BGR; stamp: of the release; position: in steps; index, count and last: see
    FocusFrame.msg; distance: in m, NaN = unknown."""
    image: np.ndarray
    stamp: object
    position: int
    index: int
    count: int
    last: bool
    distance: float


class Photographer:
    """Takes frames with one open camera. clock: gives the stamps."""

    def __init__(self, camera, clock, frames=STILL, timeout=10.0, keep_files=True):
        if frames not in (STILL, PREVIEW):
            raise ValueError("frames: '%s' is neither %s nor %s" % (frames, STILL, PREVIEW))
        self._camera, self._clock, self._frames = camera, clock, frames
        self._timeout, self._keep = timeout, keep_files
        self.owed = False  # a picture that did not come in time, and is not to be taken for the next one

    def take(self):
        """(image, stamp)"""
        if self._frames == PREVIEW:
            for _ in range(STALE_PREVIEWS):
                self._camera.capture_preview()
            stamp = self._clock()
            return _decoded(self._camera.capture_preview(), "live view"), stamp
        if self.owed:
            with contextlib.suppress(CameraError):
                self._await_picture()
            self.owed = False
        stamp = self._clock()
        self._camera.capture()
        path = self._await_picture()
        image = _decoded(self._camera.download(path), path)
        if not self._keep:
            self._camera.delete(path)
        return image, stamp

    def idle(self):
        """Between pictures: hear what the camera has to say, which also keeps it awake."""
        path = self._camera.wait_for_event(0.01)
        self.owed = self.owed and not _is_picture(path)

    def _await_picture(self):
        """Path of the first new file that can be read; raw files that come with it are left alone."""
        end, others = time.monotonic() + self._timeout, []
        while time.monotonic() < end:
            path = self._camera.wait_for_event(0.5)
            if path is None:
                continue
            if _is_picture(path):
                return path
            others.append(posixpath.basename(path))
        self.owed = not others
        hint = "only %s: let the camera write JPEG" % ", ".join(others) if others else "is a card in the camera?"
        raise CameraError(CAMERA_ERROR, "waiting for the picture", "none came in %g s, %s" % (self._timeout, hint))


def _is_picture(path):
    return path is not None and path.lower().endswith(IMAGE_SUFFIXES)


def _decoded(data, name):
    image = decode_image(data)
    if image is None:
        raise CameraError(CORRUPTED, "reading %s" % name, "it is not a picture")
    return image


class Bracketer:
    """drive: FocusDrive; hold: SettingsHold; photographer: Photographer; scale: FocusScale or None (positions are then
    indices without a distance)."""

    def __init__(self, drive, hold, photographer, scale=None):
        self.drive, self.hold, self.photographer, self.scale = drive, hold, photographer, scale
        self._start = None  # to go back to

    def shoot(self, positions, publish):
        """Frames at these positions (steps, in this order), each given to publish(Shot). Returns remarks for people.

        At the end of the focus range the bracket ends early, with a remark; FocusLimit if not one frame is reached.
        Settings and focus are as before afterwards, also after an error. If the camera is lost, call restore() when
        it is back.
        """
        remarks = []
        self._start = self.drive.position
        try:
            self.hold.hold()
            remarks += self.hold.warnings
            self._sweep(list(positions), publish, remarks)
        except BaseException:
            with contextlib.suppress(CameraError):  # the first error is the one to tell
                self.restore(remarks)
            raise
        self.restore(remarks)
        return remarks

    def restore(self, remarks):
        """Focus and settings as before the last bracket."""
        try:
            if self._start is not None:
                self.drive.move_to(self._start)
        except FocusLimit as limit:
            remarks.append("%s: the start position is not reached" % limit)
        finally:
            self.hold.release()
        self._start = None

    def _sweep(self, positions, publish, remarks):
        self.drive.move_to(positions[0])
        for index in range(len(positions)):
            self.drive.wake()
            position = self.drive.position
            image, stamp = self.photographer.take()
            error, count = None, len(positions)
            if index + 1 < count:
                # The next focus before this frame is published: where there is none, this was the last, and says so.
                try:
                    self.drive.move_to(positions[index + 1])
                except FocusLimit as limit:
                    remarks.append("%s after %d of %d frames" % (limit, index + 1, count))
                    count = index + 1
                except CameraError as problem:
                    error, count = problem, index + 1
            distance = self.scale.distance(position) if self.scale else math.nan
            publish(Shot(image, stamp, position, index, count, index + 1 == count, distance))
            if error:
                raise error
            if index + 1 == count:
                return


def planned_positions(distances, scale):
    """(positions, remarks) for the focus distances of a plan, in m."""
    positions, remarks = [], []
    for distance in distances:
        if not scale.reaches(distance):
            remarks.append("%.2f m lies beyond the focus table: focused at its end" % distance)
        step = scale.step(distance)
        if step not in positions:
            positions.append(step)
    return positions, remarks
