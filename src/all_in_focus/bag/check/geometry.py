# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where do the cameras stand to each other, and how much of the colour picture gets a depth?"""
import cv2
import numpy as np

from all_in_focus.bag.check.findings import share_text
from all_in_focus.bag.rig import RigProblem, color_frame, is_possible, pose, transforms

FAR_APART = 2.0         # m between the cameras: rather mm written as m
TURNED = 60             # degrees: rather frames with other axes
LITTLE_OVERLAP = 0.3
SAMPLES_PER_CELL = 4.0  # depth pixels that meet a cell of the picture where depth is known


def check_transform(check, bag, scan, depth_head):
    """Returns the Pose of the depth camera in the colour camera's frame, or None."""
    child, parent = depth_head.frame_id, color_frame(scan, depth_head.order)
    for transform in transforms(scan):
        if not is_possible(transform):
            check.warning("the transform from %s to %s is impossible (rotation no unit quaternion, or not finite) and "
                          "refused: correct who publishes it" % (transform.child_frame_id, transform.header.frame_id))
            break
    try:
        found = pose(scan, child, parent, depth_head.order)
    except RigProblem as error:
        if not scan.tf and not scan.tf_static:
            check.error("nothing on /tf_static or /tf: record them too; rig_publisher publishes what a rig folder says")
        else:
            check.error("no transform connects depth frame '%s' with colour frame '%s': record /tf_static too, or "
                        "publish it by rig_publisher (tf2: %s)" % (child, parent, error))
        return None
    distance, angle = np.linalg.norm(found.t), np.degrees(np.linalg.norm(cv2.Rodrigues(found.R)[0]))
    where = "the depth camera stands %.4g m from the colour camera, turned by %.3g degrees" % (distance, angle)
    if child.strip("/") == parent.strip("/"):
        check.ok("both cameras have the frame '%s'" % parent)
        return found
    if found.late:
        check.warning("the transform is recorded after the first depth image, which has to wait for it: start who "
                      "publishes it before the recording")
    if distance > FAR_APART:
        check.warning("%s: are these mm?" % where)
    elif angle > TURNED:
        check.warning("%s: is it between the optical frames (Z forward, Y down)?" % where)
    elif distance == 0 and angle == 0:
        check.warning("both cameras stand at one place: was the rig calibrated?")
    check.ok(where)
    return found


def check_overlap(check, depth, cameras, found):
    """depth: H x W mm; cameras: of depth and colour; found: Pose."""
    share = overlap(depth, *cameras, found)
    if share == 0:
        check.error("no depth falls into the colour picture: check the transform and both calibrations")
    elif share < LITTLE_OVERLAP:
        check.warning("only %s of the colour picture gets a depth: check the transform and both calibrations, and "
                      "whether the sensor sees the scene" % share_text(share))
    check.ok("%s of the colour picture gets a depth" % share_text(share))


def overlap(depth, depth_camera, color_camera, found):
    """Share of the colour picture that some known depth (H x W, mm) falls into, by cells of a few pixels."""
    v, u = np.nonzero(depth)
    if not len(u):
        return 0.0
    rays = cv2.undistortPoints(np.stack([u, v], 1).astype(float)[:, None], depth_camera.K, depth_camera.D)[:, 0]
    z = depth[v, u] / 1000.0
    points = np.column_stack([rays * z[:, None], z]).dot(found.R.T) + found.t
    points = points[points[:, 2] > 0]
    if not len(points):
        return 0.0
    ideal = points[:, :2] / points[:, 2:]
    # What lies far outside would be bent into the picture by the polynomial.
    corners = np.array([[-0.1, -0.1], [1.1, 1.1]]) * [color_camera.width, color_camera.height]
    low, high = (corners - color_camera.K[:2, 2]) / color_camera.K[[0, 1], [0, 1]]
    points = points[((ideal > low) & (ideal < high)).all(axis=1)]
    if not len(points):
        return 0.0
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), color_camera.K, color_camera.D)[0][:, 0]
    cell = max(1.0, np.sqrt(SAMPLES_PER_CELL) * color_camera.K[0, 0] / depth_camera.K[0, 0])
    cols, rows = int(np.ceil(color_camera.width / cell)), int(np.ceil(color_camera.height / cell))
    x, y = np.floor((pixels + 0.5) / cell).astype(int).T
    inside = (x >= 0) & (x < cols) & (y >= 0) & (y < rows)
    return len(np.unique(y[inside] * cols + x[inside])) / (cols * rows)
