# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Is each camera calibrated, for these images, as what the nodes take it for?"""
import numpy as np

from all_in_focus.bag.rig import RigProblem, camera_of

FIELD_OF_VIEW = (3, 150)  # degrees; beyond is a mistake


def check_camera(check, bag, scan, kind, heads):
    """heads: of the images that the nodes take. Returns the Camera, or None. kind: "depth" or "rgb"."""
    name = bag.topics[kind + "_info"]
    infos = getattr(scan, kind + "_info")
    if not infos:
        check.error("%s: no message can be read" % name)
        return None
    info = infos[0].message
    try:
        camera = camera_of(info, kind)
    except RigProblem as error:
        check.error("%s: %s" % (name, error))
        return None
    _check_size(check, bag, kind, camera, heads)
    _check_frames(check, bag, kind, info, heads)
    if len(infos) > 1:
        check.warning("%s changes %d times: the nodes take the newest (a zoom? then each bracket has its own)"
                      % (name, len(infos) - 1))
    _check_rectification(check, bag, kind, info, camera)
    field = np.degrees(2 * np.arctan(camera.width / 2 / camera.K[0, 0]))
    inside = 0 <= camera.K[0, 2] < camera.width and 0 <= camera.K[1, 2] < camera.height
    if not inside or not FIELD_OF_VIEW[0] < field < FIELD_OF_VIEW[1]:
        check.warning("%s: horizontal field of view %.3g degrees, principal point %.1f, %.1f of %dx%d: was the "
                      "calibration made for these images?"
                      % (name, field, camera.K[0, 2], camera.K[1, 2], camera.width, camera.height))
    check.ok("%dx%d, fx %.1f, field of view %.1f degrees, %s"
             % (camera.width, camera.height, camera.K[0, 0], field,
                "distortion known" if camera.D.any() else "no distortion"))
    return camera


def _check_size(check, bag, kind, camera, heads):
    size = (camera.width, camera.height)
    others = sorted({head.size for head in heads if head.size and head.size != size})
    if not others:
        return
    text = ("%s is for %dx%d, the images have %s: use the calibration of this resolution"
            % (bag.topics[kind + "_info"], *size, ", ".join("%dx%d" % other for other in others)))
    fitting = [head for head in heads if head.size
               and (head.size == size if kind == "depth" else _alike(head.size, size))]
    level = check.warning if fitting else check.error
    if kind == "depth":
        level(text + "; such depth is refused")
    elif all(_alike(other, size) for other in others):
        level(text + "; until then labels are scaled")
    else:
        level(text + "; frames of another shape are refused")


def _alike(one, other):
    """Sides in the same proportion, as far as the fusion minds."""
    return abs(one[0] * other[1] / (one[1] * other[0]) - 1) <= 0.01


def _check_frames(check, bag, kind, info, heads):
    name, frame = bag.topics[kind + "_info"], info.header.frame_id
    frames = sorted({head.frame_id for head in heads})
    decisive = frames if kind == "depth" else [frame]
    if "" in decisive:
        level = check.warning if any(decisive) else check.error
        level("%s: frame_id is empty: set it in the camera's driver"
              % bag.topics["depth" if kind == "depth" else "rgb_info"])
    elif len(frames) > 1 or frames and frames[0].lstrip("/") != frame.lstrip("/"):
        check.warning("%s says frame '%s', the images '%s': the nodes go by '%s'"
                      % (name, frame, "', '".join(frames), decisive[0]))


def _check_rectification(check, bag, kind, info, camera):
    """The nodes take images as the sensor gives them, with K and D."""
    image, name = bag.topics[kind], bag.topics[kind + "_info"]
    P = np.array(info.P, float).reshape(3, 4)[:, :3]
    if "rect" in image.rsplit("/", 1)[-1] and camera.D.any():
        check.warning("%s seems to be rectified, but %s has distortion, which would be applied again: take the raw "
                      "images, or publish D = 0 and K = P" % (image, name))
    elif not camera.D.any() and P[0, 0] > 0 and not np.allclose(P, np.array(info.K).reshape(3, 3), rtol=0.01, atol=1):
        check.warning("%s has no distortion, but P (fx %.1f) is not K (fx %.1f), as of rectified images: the nodes use "
                      "K and D" % (name, P[0, 0], info.K[0]))
