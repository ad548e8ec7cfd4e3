# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a calibration found, as calibration.yaml, and what its views do not determine well."""
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

VERSION = 2  # of calibration.yaml
HEADER = """# How this rig was calibrated, by calibrate_rig. Of pairs and error_px: pixels RMS.
# mapping_px: of a depth pixel at 0.8 to 4 m in the color picture.
"""
MARGIN = 0.2  # of the picture, along a side, that may have no corner
SIDES = ("left", "top", "right", "bottom")
DEVIATION = 0.01  # of the focal length
FEW = 12  # views


def view_warnings(name, fit, corners, size):
    """Yields what the views of one camera do not determine well; nothing of a known one. fit: CameraFit; corners: by view;
    size: (w, h)."""
    if not fit.deviations:
        return
    if len(fit.errors) < FEW:
        yield f"the {name} camera has {len(fit.errors)} views of the board only, 20 are good"
    used = np.concatenate([corners[view] for view in fit.errors]) / size
    for side, share in zip(SIDES, (*used.min(axis=0), *(1 - used.max(axis=0)))):
        if share > MARGIN:
            yield f"no board in the {side} {100 * share:.0f} % of the {name} picture: its distortion there is a guess"
    for term, value in (("fx", fit.K[0, 0]), ("fy", fit.K[1, 1])):
        share = fit.deviations[term] / value
        if share > DEVIATION:
            yield (f"{term} of the {name} camera is known to {100 * share:.1f} % only: take more views, each tilted "
                   "differently, by 30 degrees and more")


def _plain(values, digits=4):
    return np.round(np.ravel(values).astype(float), digits).tolist()


def _camera_record(fit, camera):
    terms = dict(zip(("fx", "fy", "cx", "cy"), _plain(camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], 2)))
    sure = {term: round(value, 6) for term, value in fit.deviations.items()}
    return {"error_px": round(fit.rms, 4), "views": len(fit.errors), **terms, "distortion": _plain(camera.D),
            **({"standard_deviations": sure} if sure else {"known": True})}


def record(fit, rig, names, board, offset, warnings):
    """Text of calibration.yaml. fit: RigFit; rig: as it is written; offset: of the depth image against the pictures of the
    board (x, y), pixels."""
    pairs = []
    for name in names:
        errors = fit.errors.get(name, [part.errors.get(name) for part in (fit.depth, fit.color)])
        depth, color = (None if error is None else round(error, 3) for error in errors)
        row = {"pair": name, "depth": depth, "color": color}
        pairs.append({**row, "remark": fit.remarks[name]} if name in fit.remarks else row)
    position, rotation, mapping = fit.deviations
    angles = Rotation.from_quat(rig.quaternion).as_euler("xyz", degrees=True)
    data = {
        "version": VERSION, "board": str(board), "square_mm": round(1000 * board.square, 6),
        "ir_offset_px": _plain(offset),
        "pairs": pairs,
        "depth": _camera_record(fit.depth, rig.depth),
        "color": _camera_record(fit.color, rig.color),
        "depth_in_color": {"translation_mm": _plain(1000 * rig.t, 1), "rotation_deg": _plain(angles, 2)},
        "standard_deviations": {"translation_mm": _plain(1000 * position),
                                "rotation_deg": round(float(np.degrees(rotation)), 5),
                                "mapping_px": mapping if mapping is None else round(mapping, 4)},
        "refined_jointly": fit.jointly,
        "pairs_used": len(fit.errors),
        "error_px": round(fit.rms, 4)}
    return (HEADER + yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=1000)
            + yaml.safe_dump({"warnings": list(warnings)}, default_flow_style=False, width=1000))
