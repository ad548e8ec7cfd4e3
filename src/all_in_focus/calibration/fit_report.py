# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a calibration found, as text for people and as calibration.yaml, and what its views do not determine well."""
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

VERSION = 1  # of calibration.yaml
MARGIN = 0.2  # of the picture, along a side, that may have no corner
SIDES = ("left", "top", "right", "bottom")
TILT = 12.0  # degrees between two boards: with less, focal length and distance cannot be told apart
DEVIATION = 0.01  # of the focal length
FEW = 12  # views


def uncovered(corners, size):
    """[(side, share of the picture along it without a corner)] of sides above MARGIN; corners: N x 2, pixels."""
    low, high = corners.min(axis=0) / size, corners.max(axis=0) / size
    return [(side, share) for side, share in zip(SIDES, (low[0], low[1], 1 - high[0], 1 - high[1])) if share > MARGIN]


def tilt_range(normals):
    """Largest angle between two boards, degrees; normals: N x 3."""
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1)).max()))


def view_warnings(name, fit, corners, size, known):
    """Yields what the views of one camera do not determine well. fit: CameraFit; corners: by view; size: (w, h)."""
    used = [points for view, points in corners.items() if view in fit.errors]
    if not known and len(used) < FEW:
        yield f"the {name} camera has {len(used)} views of the board only, 20 are good"
    if used and not known:
        for side, share in uncovered(np.concatenate(used), size):
            yield (f"no board in the {side} {100 * share:.0f} % of the {name} picture: its distortion there is a "
                   "guess")
        widest = tilt_range(np.array(list(fit.tilts.values())))
        if widest < TILT:
            yield (f"all boards have nearly the same tilt to the {name} camera ({widest:.0f} degrees apart): its "
                   "focal length is poorly determined, tilt each differently, by 30 degrees and more")
    for term, value in (("fx", fit.K[0, 0]), ("fy", fit.K[1, 1])):
        share = fit.deviations.get(term, 0) / value
        if share > DEVIATION:
            yield f"{term} of the {name} camera is known to {100 * share:.1f} % only: take more views with more tilt"


def reasons(fit):
    """By pair: why it was not used, or by one camera only."""
    found = dict(fit.missing)
    for part in (fit.left_out, fit.depth.left_out, fit.color.left_out):
        found.update({name: f"left out: {reason}" for name, reason in part.items()})
    return found


def _errors_of(fit, name):
    return fit.errors.get(name) or (fit.depth.errors.get(name), fit.color.errors.get(name))


def table(fit, names):
    """One line per pair: RMS errors in both cameras, and why it was left out."""
    said, width = reasons(fit), max([4] + [len(name) for name in names])
    yield f"{'pair':<{width}}   depth   color   px RMS"
    for name in names:
        depth, color = (f"{error:5.2f}" if error is not None else "    -" for error in _errors_of(fit, name))
        yield f"{name:<{width}}   {depth}   {color}   {said.get(name, '')}".rstrip()


def _camera_line(name, fit, camera):
    values = [f"{term} {value:.2f}" + (f" +- {fit.deviations[term]:.2f}" if term in fit.deviations else " (known)")
              for term, value in zip(("fx", "fy", "cx", "cy"),
                                     (fit.K[0, 0], fit.K[1, 1], fit.K[0, 2], fit.K[1, 2]))]
    distortion = " ".join(f"{value:.4f}" for value in camera.D)
    return f"{name} camera, {camera.width}x{camera.height}: {', '.join(values)}; distortion {distortion}"


def summary(fit, rig, offset):
    """Lines; offset: of the depth image against the pictures of the board (x, y), pixels."""
    yield _camera_line("depth", fit.depth, rig.depth)
    if any(offset):
        yield (f"  principal point in depth.yaml: moved by the offset of the depth image, ({offset[0]:+.2f}, "
               f"{offset[1]:+.2f}) px, to ({rig.depth.K[0, 2]:.2f}, {rig.depth.K[1, 2]:.2f})")
    yield _camera_line("color", fit.color, rig.color)
    position, rotation, mapping = fit.deviations
    angles = Rotation.from_quat(rig.quaternion).as_euler("xyz", degrees=True)
    x, y, z = 1000 * rig.t
    yield (f"depth camera in the color camera: x {x:.1f}, y {y:.1f}, z {z:.1f} mm, "
           f"+- {', '.join(f'{1000 * value:.1f}' for value in position)}; "
           f"rotated by {', '.join(f'{value:.2f}' for value in angles)} degrees, +- {np.degrees(rotation):.2f}")
    how = "both cameras refined together" if fit.jointly else "intrinsics of each camera alone"
    yield f"{len(fit.errors)} of {len(fit.errors) + len(reasons(fit))} pairs, {fit.rms:.2f} px RMS; {how}"
    if mapping is not None:
        yield f"a depth pixel at 0.8 to 4 m is placed in the color picture to +- {mapping:.2f} px"


def _plain(value, digits=6):
    return [round(float(part), digits) for part in np.ravel(value)]


def _camera_record(fit):
    record = {"error_px": round(fit.rms, 4), "views": len(fit.errors)}
    if fit.deviations:
        record["standard_deviations"] = {term: round(value, 6) for term, value in fit.deviations.items()}
    return record


def record(fit, names, board, offset, warnings):
    """Text of calibration.yaml."""
    said = reasons(fit)
    views = [{"pair": name, "error_px": [None if error is None else round(error, 4) for error in _errors_of(fit, name)],
              **({"remark": said[name]} if name in said else {})} for name in names]
    position, rotation, mapping = fit.deviations
    data = {"version": VERSION, "board": str(board), "square_mm": round(1000 * board.square, 6),
            "ir_offset_px": _plain(offset), "error_px": round(fit.rms, 4), "refined_jointly": fit.jointly,
            "depth": _camera_record(fit.depth), "color": _camera_record(fit.color),
            "standard_deviations": {"translation_mm": _plain(1000 * position, 4),
                                    "rotation_deg": round(float(np.degrees(rotation)), 5),
                                    "mapping_px": mapping if mapping is None else round(mapping, 4)},
            "warnings": list(warnings), "pairs": views}
    return ("# How this rig was calibrated, by calibrate_rig. error_px: RMS; of a pair in depth and color picture.\n"
            + yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=120))
