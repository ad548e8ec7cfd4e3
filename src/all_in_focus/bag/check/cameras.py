# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Are the cameras calibrated for these images, where do they stand, and how much of the picture gets a depth?"""
import json
import tempfile
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np

from all_in_focus import installed
from all_in_focus.bag.check.findings import share_text
from all_in_focus.bag.recorded_rig import camera_of, color_frame, pose
from all_in_focus.files.errors import counted
from all_in_focus.files.output_file import write_picture
from all_in_focus.files.rig import RigError, same_shape, save_rig
from all_in_focus.imaging import shrunk

WIDTH = 640  # pixels to which larger pictures are reduced: enough for the check of mirroring


def check_camera(check, bag, scan, kind, heads):
    """heads: of the images that the nodes accept. Returns the Camera, or None. kind: "depth" or "rgb"."""
    name = bag.topics[f"{kind}_info"]
    infos = getattr(scan, f"{kind}_info")
    if not infos:
        check.error(f"{name}: no message can be read")
        return None
    info = infos[0].message
    try:
        camera = camera_of(info, kind)
    except RigError as error:
        check.error(f"{name}: {error}")
        return None
    _check_size(check, bag, kind, camera, heads, infos)
    _check_frames(check, bag, kind, info, heads)
    changes = sum(not _is_scaled(one.message, other.message, kind) for one, other in zip(infos, infos[1:]))
    if changes:
        check.warning(f"{name} changes {counted(changes, 'time')}: the nodes always use the newest one. If the lens was "
                      "zoomed, every bracket is fused with the calibration of its time")
    _check_rectification(check, bag, kind, info, camera)
    field = np.degrees(2 * np.arctan(camera.width / 2 / camera.K[0, 0]))
    check.ok(f"{camera.width}x{camera.height}, fx {camera.K[0, 0]:.1f}, field of view {field:.1f} degrees, "
             f"{'distortion known' if camera.D.any() else 'no distortion'}")
    return camera


def _is_scaled(one, other, kind):
    """Whether two camera infos differ by the size of the pictures alone: a camera node announces its calibration before it knows
    the size."""
    try:
        one, other = camera_of(one, kind), camera_of(other, kind)
    except RigError:
        return False
    scaled = one.scaled(other.width, other.height)
    return (one.width, one.height) != (other.width, other.height) and np.allclose(scaled.K, other.K) and np.array_equal(
        one.D, other.D)


def _check_size(check, bag, kind, camera, heads, infos):
    size = (camera.width, camera.height)
    known = {(info.message.width, info.message.height) for info in infos} if kind == "rgb" else {size}
    others = sorted({head.size for head in heads} - known)
    if not others:
        return
    found = ", ".join(f"{width}x{height}" for width, height in others)
    text = (f"{bag.topics[f'{kind}_info']} is for {size[0]}x{size[1]}, the images have {found}: use the calibration of "
            "this resolution")
    fitting = [head for head in heads if (head.size == size if kind == "depth" else same_shape(head.size, size))]
    refused = "such depth is refused" if kind == "depth" else "frames of another shape are refused, others scaled"
    (check.warning if fitting else check.error)(f"{text}; {refused}")


def _check_frames(check, bag, kind, info, heads):
    name, frame = bag.topics[f"{kind}_info"], info.header.frame_id
    frames = sorted({head.frame_id for head in heads})
    decisive = frames if kind == "depth" else [frame]
    if "" in decisive:
        level = check.warning if any(decisive) else check.error
        level(f"{bag.topics['depth' if kind == 'depth' else 'rgb_info']}: frame_id is empty: set it in the camera's driver")
    elif len(frames) > 1 or frames and frames[0].lstrip("/") != frame.lstrip("/"):
        found = "', '".join(frames)
        check.warning(f"{name} says frame '{frame}', the images '{found}': the nodes go by '{decisive[0]}'")


def _check_rectification(check, bag, kind, info, camera):
    """Warns of rectified images: the nodes expect images of the sensor, and apply K and D."""
    image, name = bag.topics[kind], bag.topics[f"{kind}_info"]
    P = np.array(info.P, float).reshape(3, 4)[:, :3]
    if "rect" in image.rsplit("/", 1)[-1] and camera.D.any():
        check.warning(f"{image} seems to be rectified, but {name} has distortion, which would be applied again: "
                      "take the raw images, or publish D = 0 and K = P")
    elif not camera.D.any() and P[0, 0] > 0 and not np.allclose(P, np.array(info.K).reshape(3, 3), rtol=0.01, atol=1):
        check.warning(f"{name} has no distortion, but P (fx {P[0, 0]:.1f}) is not K "
                      f"(fx {info.K[0]:.1f}), as of rectified images: the nodes use K and D")


def rig_warnings(rig, depth, picture):
    """What fuse_stack and the nodes say of rig and depth, with the members of RigWarnings in src/tools/rig_warnings.hpp, and
    coverage: share of the picture that gets a depth. rig: Rig; depth: H x W mm; picture: H x W x 3 of the colour camera, or None.

    Raises RuntimeError where check_depth, a program of this package, cannot be run.
    """
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        save_rig(folder / "rig", rig)
        write_picture(folder / "depth.png", depth)
        command = [installed.find("check_depth"), "--rig", str(folder / "rig"), "--depth", str(folder / "depth.png")]
        if rig.optics:
            command += ["--optics", str(rig.optics)]
        if picture is not None:
            write_picture(folder / "color.png", shrunk(picture, WIDTH))
            command += ["--color", str(folder / "color.png")]
        return SimpleNamespace(**json.loads(installed.run(command)))


def check_transform(check, bag, scan, depth_head, ask):
    """ask: rig_warnings() of a Pose of the depth camera in the colour camera's frame, or None. Returns its answer."""
    child, parent = depth_head.frame_id, color_frame(scan, depth_head.order)
    try:
        found = pose(scan, child, parent, depth_head.order)
    except RigError as error:
        problem = "nothing on /tf_static or /tf"
        if scan.tf or scan.tf_static:
            problem = (f"no transform connects depth frame '{child}' with colour frame '{parent}' ({error}; impossible "
                       "ones are ignored)")
        check.error(f"{problem}: record them too; rig_publisher publishes what a rig folder says")
        return None
    distance, angle = np.linalg.norm(found.t), np.degrees(np.linalg.norm(cv2.Rodrigues(found.R)[0]))
    if child.strip("/") == parent.strip("/"):
        check.ok(f"both cameras have the frame '{parent}'")
        return ask(found)
    if found.late:
        check.warning("the transform is recorded after the first depth image, so that image has to wait for it: start "
                      "the node that publishes the transform before you record")
    said = ask(found)
    for warning in (said.depth_center, said.color_center, said.pose) if said else ():
        if warning:
            check.warning(warning)
    if distance == 0 and angle == 0:
        check.warning("both cameras stand at one place: was the rig calibrated?")
    check.ok(f"the depth camera stands {distance:.4g} m from the colour camera, rotated by {angle:.3g} degrees")
    return said


def check_overlap(check, said):
    """said: of rig_warnings()."""
    if said.overlap:
        (check.error if said.apart else check.warning)(said.overlap)
    if said.mirroring:
        check.warning(said.mirroring)
    check.ok(f"{share_text(said.coverage)} of the colour picture gets a depth")
