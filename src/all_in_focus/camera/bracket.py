# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shoots one focus bracket: fixes the settings, takes the frames one by one, restores focus and settings."""
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
STALE_PREVIEWS = 1  # live view frames that may have been exposed before the lens came to rest


@dataclass
class Shot:
    """One frame of a bracket. image: BGR; stamp: time of the release; position: in steps; index, count and last: see
    FocusFrame.msg; distance: in m, NaN = unknown."""
    image: np.ndarray
    stamp: object
    position: int
    index: int
    count: int
    last: bool
    distance: float


class Photographer:
    """Takes single pictures with an open camera. clock: gives the stamps."""

    def __init__(self, camera, clock, frames=STILL, timeout=10.0, keep_files=True):
        if frames not in (STILL, PREVIEW):
            raise ValueError(f"frames: '{frames}' is neither {STILL} nor {PREVIEW}")
        self._camera, self._clock, self._frames = camera, clock, frames
        self._timeout, self._keep = timeout, keep_files
        self.owed = False  # a picture timed out; if it arrives after all, it must not be taken for the next one

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
        """Handle an event between brackets; this also keeps the camera awake."""
        path = self._camera.wait_for_event(0.01)
        self.owed = self.owed and not _is_picture(path)

    def _await_picture(self):
        """Path of the first new file that can be read; raw files beside it stay on the card."""
        end, others = time.monotonic() + self._timeout, []
        while time.monotonic() < end:
            path = self._camera.wait_for_event(0.5)
            if path is None:
                continue
            if _is_picture(path):
                return path
            others.append(posixpath.basename(path))
        self.owed = not others
        hint = f"only {', '.join(others)}: let the camera write JPEG" if others else "is a card in the camera?"
        raise CameraError(CAMERA_ERROR, "waiting for the picture", f"none came in {self._timeout:g} s, {hint}")


def _is_picture(path):
    return path is not None and path.lower().endswith(IMAGE_SUFFIXES)


def _decoded(data, name):
    image = decode_image(data)
    if image is None:
        raise CameraError(CORRUPTED, f"reading {name}", "it is not a picture")
    return image


class Bracketer:
    """drive: FocusDrive; hold: SettingsHold; photographer: Photographer; scale: FocusScale, or None if the focus
    distances are unknown."""

    def __init__(self, drive, hold, photographer, scale=None):
        self.drive, self.hold, self.photographer, self.scale = drive, hold, photographer, scale
        self._start = None  # focus position before the bracket

    def shoot(self, positions, publish):
        """Take a frame at each position (in steps, in this order) and give it to publish(Shot). Returns warnings.

        At the end of the focus range the bracket ends early, with a warning; it raises FocusLimit if not even the first
        frame can be reached. Focus and settings are restored afterwards, also after an error. If the camera was lost,
        call restore() when it is back.
        """
        warnings = []
        self._start = self.drive.position
        try:
            self.hold.hold()
            warnings += self.hold.warnings
            self._sweep(list(positions), publish, warnings)
        except BaseException:
            with contextlib.suppress(CameraError):  # report the first error, not this one
                self.restore(warnings)
            raise
        self.restore(warnings)
        return warnings

    def restore(self, warnings):
        """Focus and settings as before the last bracket."""
        try:
            if self._start is not None:
                self.drive.move_to(self._start)
        except FocusLimit as limit:
            warnings.append(f"{limit}: the start position is not reached")
        finally:
            self.hold.release()
        self._start = None

    def _sweep(self, positions, publish, warnings):
        self.drive.move_to(positions[0])
        for index in range(len(positions)):
            self.drive.wake()
            position = self.drive.position
            image, stamp = self.photographer.take()
            failure, count = None, len(positions)
            if index + 1 < count:
                # Move on before this frame is published: if the next position cannot be reached, this frame is the
                # last one and has to say so.
                try:
                    self.drive.move_to(positions[index + 1])
                except FocusLimit as limit:
                    warnings.append(f"{limit} after {index + 1} of {count} frames")
                    count = index + 1
                except CameraError as error:
                    failure, count = error, index + 1
            distance = self.scale.distance(position) if self.scale else math.nan
            publish(Shot(image, stamp, position, index, count, index + 1 == count, distance))
            if failure:
                raise failure
            if index + 1 == count:
                return


def planned_positions(distances, scale):
    """(positions, warnings) for the focus distances of a plan, in m."""
    positions, warnings = [], []
    for distance in distances:
        if not scale.reaches(distance):
            warnings.append(f"{distance:.2f} m lies beyond the focus table: focused at its end")
        step = scale.step(distance)
        if step not in positions:
            positions.append(step)
    return positions, warnings
