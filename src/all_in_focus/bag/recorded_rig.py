# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The rig of a bag, as the nodes see it: cameras from CameraInfo, the pose from tf."""
from typing import NamedTuple

import genpy
import numpy as np
import tf2_py
from scipy.spatial.transform import Rotation

from all_in_focus.bag.scan import newest
from all_in_focus.files.errors import one_line
from all_in_focus.files.rig import Camera, Optics, RigError, check_matrix, distortion_of, rotation_matrix

MAX_SIZE = 32767  # pixels
MAX_PIXELS = 100_000_000
FOREVER = genpy.Duration(10 ** 8)


def camera_of(info, name):
    """Camera of the images as sent: with binning and region of interest applied. RigError."""
    if not (0 < info.width <= MAX_SIZE and 0 < info.height <= MAX_SIZE and info.width * info.height <= MAX_PIXELS):
        raise RigError(f"image size is {info.width}x{info.height}, not 1x1 to 100 megapixels: calibrate the camera")
    K = np.array(info.K, float).reshape(3, 3)
    model = info.distortion_model or "plumb_bob"
    check_matrix(K)
    D = distortion_of(model, info.D if info.distortion_model else [])

    roi, bins = info.roi, np.maximum(1, [info.binning_x, info.binning_y])
    if roi.x_offset + roi.width > info.width or roi.y_offset + roi.height > info.height:
        raise RigError(f"the region of interest ({roi.width}x{roi.height} at {roi.x_offset}, {roi.y_offset}) "
                       f"is not inside the image of {info.width}x{info.height}")
    size = np.array([roi.width, roi.height] if roi.width and roi.height else [info.width, info.height]) // bins
    if not size.all():
        raise RigError(f"binning of {bins[0]}x{bins[1]} leaves an image of {size[0]}x{size[1]}")
    cut = bins.max() > 1 or bool(roi.x_offset or roi.y_offset)
    offset = np.array([roi.x_offset, roi.y_offset])
    K[:2, 2] = (K[:2, 2] - offset + 0.5) / bins - 0.5  # the centre of a binned pixel lies half a bin inside
    K[0, 0], K[1, 1] = K[0, 0] / bins[0], K[1, 1] / bins[1]
    R, P = np.array(info.R, float).reshape(3, 3), np.array(info.P, float).reshape(3, 4)
    if cut or not P.any():
        P = None
    return Camera(name, int(size[0]), int(size[1]), K, D, model, R if R.any() else None, P)


class Pose(NamedTuple):
    """X_parent = R X_child + t (3x3, metres); quaternion: x, y, z, w as in the bag; late: whether it was recorded only
    after it was needed."""
    R: np.ndarray
    t: np.ndarray
    quaternion: list
    late: bool


def pose(scan, child, parent, order):
    """Pose from the newest transforms recorded up to `order`, else from the first ones that connect both frames.
    RigError where none do."""
    if child.strip("/") == parent.strip("/"):
        return Pose(np.eye(3), np.zeros(3), [0.0, 0.0, 0.0, 1.0], False)
    buffer, frames = tf2_py.BufferCore(FOREVER), (parent.lstrip("/"), child.lstrip("/"))
    for small in scan.tf_static:
        for transform in _good(small.message):
            buffer.set_transform_static(transform, "bag")
    late = False
    for small in scan.tf:
        if small.order > order:
            if all(frames) and buffer.can_transform_core(*frames, genpy.Time())[0]:  # tf2 prints a line of empty names
                break
            late = True
        for transform in _good(small.message):
            buffer.set_transform(transform, "bag")
    try:
        found = buffer.lookup_transform_core(*frames, genpy.Time())
    except tf2_py.TransformException as error:
        raise RigError(one_line(error))
    q, t = found.transform.rotation, found.transform.translation
    quaternion = [q.x, q.y, q.z, q.w]
    return Pose(rotation_matrix(Rotation.from_quat(quaternion)), np.array([t.x, t.y, t.z]), quaternion, late)


def camera_at(scan, kind, order):
    """Camera of kind "depth" or "rgb" at the time `order` of a Scan. RigError."""
    small = newest(getattr(scan, f"{kind}_info"), order)
    if small is None:
        raise RigError("there is no camera info")
    return camera_of(small.message, {"rgb": "color"}.get(kind, kind))


def color_frame(scan, order):
    """Frame id of the colour camera, from its camera info."""
    small = newest(scan.rgb_info, order)
    return small.message.header.frame_id if small else ""


def depth_problem(scan, head):
    """Why depth_preprocess would refuse a depth image of a Scan, or ""; transforms are not considered."""
    if not head.frame_id:
        return "frame_id is empty: set it in the camera's driver"
    if head.problem:
        return head.problem
    try:
        camera = camera_at(scan, "depth", head.order)
    except RigError as error:
        return str(error)
    if head.size != (camera.width, camera.height):
        return (f"depth is {head.size[0]}x{head.size[1]}, but its camera info is for {camera.width}x{camera.height}: use the "
                "calibration of this resolution")
    return ""


def optics_at(scan, order):
    """Optics at the time `order` of a Scan, or None where they are unknown or impossible."""
    small = newest(scan.optics, order)
    if small is None:
        return None
    optics = Optics(small.message.focal_length_mm, small.message.aperture, small.message.circle_of_confusion_mm)
    try:
        optics.validate("")
    except RigError:
        return None
    return optics


def _is_possible(transform):
    """Whether the rotation is a unit quaternion and all numbers are finite."""
    q, t = transform.transform.rotation, transform.transform.translation
    values = np.array([q.x, q.y, q.z, q.w, t.x, t.y, t.z])
    return bool(np.isfinite(values).all()) and abs(np.linalg.norm(values[:4]) - 1) < 1e-3


def _good(message):
    # tf2 refuses the others too, and prints a message for each.
    return [transform for transform in message.transforms if _is_possible(transform)
            and transform.header.frame_id and transform.child_frame_id
            and transform.header.frame_id.strip("/") != transform.child_frame_id.strip("/")]
