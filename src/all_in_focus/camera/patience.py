# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Busy cameras are asked again."""
import time

from all_in_focus.camera.interface import Camera, CameraError

FIRST_PAUSE, LONGEST_PAUSE = 0.05, 0.5  # s


class PatientCamera(Camera):
    """Passes every call on; one that fails because the camera is busy is repeated for up to `patience` seconds."""

    def __init__(self, camera, patience=5.0):
        self._camera, self._patience = camera, patience

    def _ask(self, call, *arguments):
        end, pause = time.monotonic() + self._patience, FIRST_PAUSE
        while True:
            try:
                return call(*arguments)
            except CameraError as error:
                if not error.busy or time.monotonic() + pause > end:
                    raise
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    def open(self):
        return self._ask(self._camera.open)

    def close(self):
        self._camera.close()

    def get_config(self, name):
        return self._ask(self._camera.get_config, name)

    def set_config(self, name, value):
        self._ask(self._camera.set_config, name, value)

    def capture(self):
        self._ask(self._camera.capture)

    def wait_for_event(self, seconds):
        return self._ask(self._camera.wait_for_event, seconds)

    def capture_preview(self):
        return self._ask(self._camera.capture_preview)

    def download(self, path):
        return self._ask(self._camera.download, path)

    def delete(self, path):
        self._ask(self._camera.delete, path)
