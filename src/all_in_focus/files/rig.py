# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A rig folder: depth.yaml, color.yaml, extrinsics.yaml and, optionally, optics.yaml.

The cameras are camera_info files as camera_calibration writes them; extrinsics.yaml holds the pose of the depth camera
in the colour camera's optical frame, X_color = R X_depth + t (metres); optics.yaml holds the lens of the colour camera.
"""
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Optional

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from all_in_focus.files import yaml_file
from all_in_focus.files.errors import counted

DISTORTION_COEFFICIENTS = {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}
KNOWN_TO_OPENCV = (0, 4, 5, 8, 12, 14)
LARGEST_SKEW = 0.1  # pixels
SHAPE_TOLERANCE = 0.01  # as that of the fusion
# What a lens can have, as in include/all_in_focus/optics.hpp.
OPTICS_RANGES = {"focal_length_mm": (0.1, 10000.0), "aperture": (0.1, 1000.0), "circle_of_confusion_mm": (1e-6, 10.0)}


class RigError(ValueError):
    """A rig, camera or lens that is missing, wrong or refused by the nodes; the message says what, of a file also its name and
    the key."""


def rotation_matrix(rotation):
    """3x3 matrix of a scipy Rotation (as_matrix, which scipy before 1.4 does not have)."""
    return rotation.apply(np.eye(3)).T


def distortion_of(model, coefficients, where=""):
    """The coefficients of ROS' models plumb_bob (5), rational_polynomial (8) and equidistant (4); drivers pad with zeros.
    RigError, which begins with `where`."""
    if model not in DISTORTION_COEFFICIENTS:
        raise RigError(f'{where}distortion model "{model}" is not supported: use plumb_bob, rational_polynomial or equidistant')
    most, D = DISTORTION_COEFFICIENTS[model], np.array(coefficients, float)
    if not np.isfinite(D).all():
        raise RigError(f"{where}{model} has {most} distortion coefficients, all finite, not these: calibrate again")
    if len(D) not in KNOWN_TO_OPENCV or D[most:].any():
        raise RigError(f"{where}{model} has {most} distortion coefficients, not {len(D)}: calibrate again")
    return np.pad(D[:most], (0, max(0, most - len(D))), "constant")


def same_shape(one, other):
    """Whether two sizes (width, height) have the same aspect ratio, within the tolerance of the fusion."""
    return abs(one[0] * other[1] / (one[1] * other[0]) - 1) <= SHAPE_TOLERANCE


def check_matrix(K, where=""):
    """RigError, which begins with `where`, for a camera matrix (3x3) that says less or more than fx, fy, cx, cy: nothing here
    would use it."""
    if not (np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0):
        raise RigError(f"{where}the camera is not calibrated (fx = {K[0, 0]:g}, fy = {K[1, 1]:g}): calibrate it, or give its "
                       "driver a calibration file")
    if abs(K[0, 1]) > LARGEST_SKEW:
        raise RigError(f"{where}the camera matrix has a skew, {K[0, 1]:g}, which is not supported: calibrate without one")
    if K[1, 0] or (K[2] != (0, 0, 1)).any():
        raise RigError(f"{where}the camera matrix must be fx 0 cx, 0 fy cy, 0 0 1")


@dataclass
class Camera:
    """Pinhole camera with distortion; K, R (rectification) 3x3 and P 3x4, in pixels."""
    name: str
    width: int
    height: int
    K: np.ndarray
    D: np.ndarray = None
    distortion_model: str = "plumb_bob"
    R: np.ndarray = None
    P: np.ndarray = None

    def __post_init__(self):
        self.K = np.array(self.K, float)
        self.D = np.zeros(5) if self.D is None else np.array(self.D, float)
        self.R = np.eye(3) if self.R is None else np.array(self.R, float)
        self.P = np.hstack([self.K, np.zeros((3, 1))]) if self.P is None else np.array(self.P, float)

    @classmethod
    def pinhole(cls, name, width, height, fx, fy, cx, cy):
        """Camera without distortion."""
        return cls(name, width, height, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

    @property
    def is_fisheye(self):
        return self.distortion_model == "equidistant"

    def scaled(self, width, height):
        """The same view on another number of pixels; the centre of a pixel has whole coordinates."""
        x, y = width / self.width, height / self.height
        scale = np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])
        return replace(self, width=width, height=height, K=scale @ self.K, P=scale @ self.P)


@dataclass
class Optics:
    """Thin lens: focal length (mm), f-number, circle of confusion (mm)."""
    focal_length_mm: float
    aperture: float
    circle_of_confusion_mm: float

    @classmethod
    def parse(cls, text):
        """Optics from 'f,F,coc', such as '24,4.0,0.019'."""
        try:
            values = [float(part) for part in text.split(",")]
        except ValueError:
            values = []
        if len(values) != 3 or not all(value > 0 for value in values):
            raise RigError(f"optics '{text}': expected three positive numbers f,F,coc")
        optics = cls(*values)
        optics.validate(f"optics '{text}'")
        return optics

    def __str__(self):
        """As parse() reads it, to the last bit."""
        return ",".join(np.format_float_positional(value, trim="-") for value in vars(self).values())

    def validate(self, where):
        """Raises RigError, which begins with `where`, unless a lens can have these values."""
        for name, (least, most) in OPTICS_RANGES.items():
            if not least <= getattr(self, name) <= most:
                raise RigError(f"{where}: {name} must be {least:g} to {most:g}, not {getattr(self, name):g}")


DEFAULT_OPTICS = Optics(24.0, 4.0, 0.019)  # of the segmenter


@dataclass
class Rig:
    """Depth and colour camera, X_color = R X_depth + t (R 3x3, t in metres), and the colour camera's lens if known.
    quaternion: R as x, y, z, w, to the last bit as it was read."""
    depth: Camera
    color: Camera
    R: np.ndarray
    t: np.ndarray
    optics: Optional[Optics] = None
    parent_frame: str = ""
    child_frame: str = ""
    quaternion: np.ndarray = None

    def __post_init__(self):
        self.R, self.t = np.array(self.R, float), np.array(self.t, float)
        self.parent_frame = self.parent_frame or f"{self.color.name}_optical_frame"
        self.child_frame = self.child_frame or f"{self.depth.name}_optical_frame"
        if self.quaternion is None:
            import cv2  # see output_file.py
            self.quaternion = Rotation.from_rotvec(cv2.Rodrigues(self.R)[0].ravel()).as_quat()


class _Reader:
    """One YAML file, read key by key; errors name file and key. Values are read as texts: a name may be a serial number."""

    def __init__(self, path):
        self.path, self.data = path, yaml_file.read(path, RigError, yaml.BaseLoader)
        if not isinstance(self.data, dict):
            raise RigError(f"{path}: expected keys and values")

    def fail(self, key, reason):
        raise RigError(f"{self.path}: {key}: {reason}")

    def text(self, key, default=None):
        value = self.data.get(key, default)
        return value if isinstance(value, str) and value not in ("", "~") else self.fail(key, "expected a name")

    def numbers(self, key, shape=()):
        """Finite numbers in the given shape, those of a matrix from its data; shape None: any list."""
        node = self.data.get(key)
        try:
            values = np.array(node["data"] if isinstance(node, dict) else node, float)
            if np.isfinite(values).all() and values.ndim < 2:
                return values.reshape(values.size if shape is None else shape)
        except (KeyError, TypeError, ValueError):
            pass
        expected = "finite numbers" if shape is None else counted(np.prod(shape, dtype=int), "finite number")
        return self.fail(key, f"expected {expected}")

    def size(self, key):
        value = self.numbers(key)
        return int(value) if value >= 1 and value % 1 == 0 else self.fail(key, "expected a positive whole number")


def load_camera(path):
    file = _Reader(path)
    K = file.numbers("camera_matrix", (3, 3))
    check_matrix(K, f"{path}: camera_matrix: ")
    model, kind = file.text("distortion_model", "plumb_bob"), file.text("camera_model", "pinhole")
    if kind != "pinhole" and (kind, model) != ("fisheye", "equidistant"):
        file.fail("camera_model", f"'{kind}' is not supported: use pinhole, or fisheye with distortion_model: equidistant "
                                  "(OpenCV's fisheye model)")
    for key in ("binning_x", "binning_y"):
        if key in file.data and file.numbers(key) not in (0, 1):
            file.fail(key, "is not supported in a file: give the calibration of the binned pictures")
    D = file.numbers("distortion_coefficients", None) if any(key.startswith("distortion") for key in file.data) else []
    R, P = (file.numbers(key, shape) if key in file.data else None
            for key, shape in (("rectification_matrix", (3, 3)), ("projection_matrix", (3, 4))))
    return Camera(file.text("camera_name", "camera"), file.size("image_width"), file.size("image_height"), K,
                  distortion_of(model, D, f"{path}: "), model, R, P)


def load_rig(folder):
    """Rig from its folder; `optics` is None where optics.yaml does not exist. Raises RigError."""
    folder = Path(folder)
    depth, color = load_camera(folder / "depth.yaml"), load_camera(folder / "color.yaml")
    file, optics = _Reader(folder / "extrinsics.yaml"), None
    parent, child = file.text("parent_frame"), file.text("child_frame")
    if _is_of(parent, depth) and _is_of(child, color) and not _is_of(parent, color) and not _is_of(child, depth):
        file.fail("parent_frame", "is that of the depth camera: give the pose of the depth camera in the colour camera's frame")
    quaternion = file.numbers("rotation", (4,))
    if abs(np.linalg.norm(quaternion) - 1) > 1e-3:
        file.fail("rotation", "expected a unit quaternion x, y, z, w")
    if (folder / "optics.yaml").exists():
        lens = _Reader(folder / "optics.yaml")
        optics = Optics(*(float(lens.numbers(name)) for name in OPTICS_RANGES))
        optics.validate(lens.path)
    return Rig(depth, color, rotation_matrix(Rotation.from_quat(quaternion)), file.numbers("translation", (3,)), optics, parent,
               child, quaternion)


def _is_of(frame, camera):
    return bool(camera.name) and frame.startswith(camera.name)


def _matrix(values, rows):
    return {"rows": rows, "cols": np.size(values) // rows, "data": _plain(values)}


def _plain(values):
    return np.ravel(values).astype(float).tolist()


def save_camera(path, camera):
    yaml_file.write(path, {"image_width": camera.width, "image_height": camera.height, "camera_name": camera.name,
                           "camera_matrix": _matrix(camera.K, 3), "distortion_model": camera.distortion_model,
                           "distortion_coefficients": _matrix(camera.D, 1), "rectification_matrix": _matrix(camera.R, 3),
                           "projection_matrix": _matrix(camera.P, 3)})


def save_rig(folder, rig):
    """Writes the rig into `folder`, which is made if needed."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    save_camera(folder / "depth.yaml", rig.depth)
    save_camera(folder / "color.yaml", rig.color)
    yaml_file.write(folder / "extrinsics.yaml",
                    {"parent_frame": rig.parent_frame, "child_frame": rig.child_frame, "translation": _plain(rig.t),
                     "rotation": _plain(rig.quaternion)},
                    "# Pose of the depth camera in the colour camera's optical frame: X_color = R * X_depth + t (metres).\n"
                    "# rotation: quaternion x, y, z, w\n")
    if rig.optics is not None:
        yaml_file.write(folder / "optics.yaml", {name: float(value) for name, value in vars(rig.optics).items()},
                        "# Lens of the colour camera\n")
