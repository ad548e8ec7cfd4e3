# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A camera through libgphoto2: the calls that a focus bracket needs."""
import contextlib
import posixpath

import gphoto2 as gp

from all_in_focus.camera.interface import (BAD_PARAMETERS, IO, MODEL_NOT_FOUND, NOT_SUPPORTED, UNKNOWN_PORT, CameraError, Widget)

_CHOICES = (gp.GP_WIDGET_RADIO, gp.GP_WIDGET_MENU)
# Since version 2.5, python-gphoto2 wants a file to write into before the context, and makes one where it is None.
_NEW_FILE = (None,) if [int(part) for part in gp.__version__.split(".")[:2]] >= [2, 5] else ()


class GphotoCamera:
    """The camera at a port (usb:001,004 or disk:/folder), or the first one found.

    model: as libgphoto2 names it; needed for ports that cannot be asked for it. All calls but close() may raise
    CameraError. A path is the full name of a file on the camera.
    """

    def __init__(self, port="", model=""):
        self._port, self._model = port, model
        self._camera = None
        self._captured = []  # paths that capture() itself has returned
        self._driver_messages = []  # during the current call
        self._context = gp.Context()
        self._callback = self._context.set_error_func(self._note, None)

    def _note(self, _context, text, *_data):
        self._driver_messages.append(text.decode(errors="replace") if isinstance(text, bytes) else text)

    @contextlib.contextmanager
    def _errors(self, doing):
        del self._driver_messages[:]
        try:
            yield
        except gp.GPhoto2Error as error:
            raise CameraError(error.code, doing, "; ".join(self._driver_messages) or error.string)

    @contextlib.contextmanager
    def _opened(self, doing):
        """The open camera, whose errors become CameraError."""
        if self._camera is None:
            raise CameraError(IO, detail="not open")
        with self._errors(doing):
            yield self._camera

    def open(self):
        """The name of the model."""
        self.close()
        camera = gp.Camera()
        with self._errors("opening the camera"):
            models, ports, port = gp.CameraAbilitiesList(), gp.PortInfoList(), self._port
            models.load(self._context)
            ports.load()
            if self._model:
                camera.set_abilities(models[_look_up("model", self._model, models.lookup_model)])
                if not port or port.startswith("usb:"):
                    port = self._port_among(models.detect(ports, self._context))
            if port:
                camera.set_port_info(ports[_look_up("port", port, ports.lookup_path)])
            camera.init(self._context)
            self._camera = camera
            return camera.get_abilities().model

    def _port_among(self, found):
        """Of the camera that was asked for: libgphoto2 itself searches only where no model is given. found: CameraList of
        those that are plugged in."""
        found = [(found.get_name(index), found.get_value(index)) for index in range(found.count())]
        for model, port in found:
            if port == self._port or (not self._port and model == self._model):
                return port
        wanted = f"'{self._model}'" + (f" at {self._port}" if self._port else "")
        names = ", ".join(f"'{model}' at {port}" for model, port in found) or "none"
        raise CameraError(MODEL_NOT_FOUND, "opening the camera", f"{wanted} is not among those found: {names}")

    def close(self):
        camera, self._camera = self._camera, None
        del self._captured[:]
        if camera is not None:
            with contextlib.suppress(gp.GPhoto2Error):
                camera.exit(self._context)

    def get_config(self, name):
        with self._opened(f"reading '{name}'") as camera:
            widget = camera.get_single_config(name, self._context)
            kind = widget.get_type()
            low, high = widget.get_range()[:2] if kind == gp.GP_WIDGET_RANGE else (None, None)
            return Widget(name, widget.get_value(), list(widget.get_choices()) if kind in _CHOICES else [], low, high,
                          bool(widget.get_readonly()))

    def set_config(self, name, value):
        doing = f"setting '{name}' to {value}"
        with self._opened(doing) as camera:
            widget = camera.get_single_config(name, self._context)
            type_of_kind = {gp.GP_WIDGET_RANGE: float, gp.GP_WIDGET_TOGGLE: int}
            try:
                widget.set_value(type_of_kind.get(widget.get_type(), str)(value))
            except (TypeError, ValueError):
                raise CameraError(BAD_PARAMETERS, doing)
            camera.set_single_config(name, widget, self._context)

    def capture(self):
        """Releases the shutter and returns at once, where the camera can; wait_for_event() delivers the picture."""
        with self._opened("releasing the shutter") as camera:
            try:
                camera.trigger_capture(self._context)
            except gp.GPhoto2Error as error:
                if error.code != NOT_SUPPORTED:
                    raise
                path = camera.capture(gp.GP_CAPTURE_IMAGE, self._context)  # waits for the picture
                self._captured.append(posixpath.join(path.folder, path.name))

    def wait_for_event(self, seconds):
        """The next event in the camera's order: the path of a new file, "" = any other; None: none came in this time."""
        if self._captured:
            return self._captured.pop(0)
        with self._opened("waiting for the camera") as camera:
            kind, data = camera.wait_for_event(max(1, round(1000 * seconds)), self._context)
        if kind == gp.GP_EVENT_FILE_ADDED:
            return posixpath.join(data.folder, data.name)
        return None if kind == gp.GP_EVENT_TIMEOUT else ""

    def capture_preview(self):
        with self._opened("reading live view") as camera:
            return _content(camera.capture_preview(*_NEW_FILE, self._context))

    def download(self, path):
        with self._opened(f"downloading {path}") as camera:
            return _content(camera.file_get(*posixpath.split(path), gp.GP_FILE_TYPE_NORMAL, *_NEW_FILE, self._context))

    def delete(self, path):
        with self._opened(f"deleting {path}") as camera:
            camera.file_delete(*posixpath.split(path), self._context)


def _look_up(what, name, look_up):
    """Index of a name in one of libgphoto2's lists. An unknown name does not mean that the camera is off."""
    try:
        return look_up(name)
    except gp.GPhoto2Error:
        raise CameraError(UNKNOWN_PORT, f"{what} '{name}'")


def _content(file):
    return bytes(memoryview(file.get_data_and_size()))
