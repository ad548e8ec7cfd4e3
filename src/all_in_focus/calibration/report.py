# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a calibration found: as text for people, and as calibration.yaml beside the rig's files."""
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

VERSION = 1


def remarks(fit):
    """By pair: why it was not used, or not by both."""
    found = dict(fit.missing)
    for part in (fit.left_out, fit.depth.left_out, fit.color.left_out):
        found.update({name: "left out: " + reason for name, reason in part.items()})
    return found


def _errors_of(fit, name):
    return fit.errors.get(name) or (fit.depth.errors.get(name), fit.color.errors.get(name))


def table(fit, names):
    """One line a pair: RMS errors in both cameras, and what is to be said."""
    said, width = remarks(fit), max([4] + [len(name) for name in names])
    yield "%-*s   depth   color   px RMS" % (width, "pair")
    for name in names:
        errors = ("%5.2f" % error if error is not None else "    -" for error in _errors_of(fit, name))
        yield ("%-*s   %s   %s   %s" % (width, name, *errors, said.get(name, ""))).rstrip()


def _camera_line(name, fit, camera):
    values = ["%s %.2f%s" % (term, value, " +- %.2f" % fit.deviations[term] if term in fit.deviations else " (known)")
              for term, value in zip(("fx", "fy", "cx", "cy"),
                                     (fit.K[0, 0], fit.K[1, 1], fit.K[0, 2], fit.K[1, 2]))]
    return "%s camera, %dx%d: %s; distortion %s" % (name, camera.width, camera.height, ", ".join(values),
                                                    " ".join("%.4f" % value for value in camera.D))


def summary(fit, rig, offset):
    """Lines; offset: of the depth image against the pictures of the board (x, y), pixels."""
    yield _camera_line("depth", fit.depth, rig.depth)
    if any(offset):
        yield ("  principal point in depth.yaml: moved by the offset of the depth image, (%+.2f, %+.2f) px, to "
               "(%.2f, %.2f)" % (*offset, rig.depth.K[0, 2], rig.depth.K[1, 2]))
    yield _camera_line("color", fit.color, rig.color)
    position, turn, mapping = fit.spread
    angles = Rotation.from_quat(rig.quaternion).as_euler("xyz", degrees=True)
    yield ("depth camera in the color camera: x %.1f, y %.1f, z %.1f mm, +- %.1f, %.1f, %.1f; turned by %.2f, %.2f, "
           "%.2f degrees, +- %.2f" % (*(1000 * rig.t), *(1000 * position), *angles, np.degrees(turn)))
    yield ("%d of %d pairs, %.2f px RMS; %s" % (len(fit.errors), len(fit.errors) + len(remarks(fit)), fit.rms,
                                                "both cameras refined together" if fit.jointly
                                                else "intrinsics of each camera alone"))
    if mapping is not None:
        yield "a depth pixel at 0.8 to 4 m is placed in the color picture to +- %.2f px" % mapping


def _plain(value, digits=6):
    return [round(float(part), digits) for part in np.ravel(value)]


def _camera_record(fit):
    record = {"error_px": round(fit.rms, 4), "views": len(fit.errors)}
    if fit.deviations:
        record["standard_deviations"] = {term: round(value, 6) for term, value in fit.deviations.items()}
    return record


def record(fit, names, board, offset, warnings):
    """calibration.yaml as text."""
    said = remarks(fit)
    views = [{"pair": name, "error_px": [None if error is None else round(error, 4) for error in _errors_of(fit, name)],
              **({"remark": said[name]} if name in said else {})} for name in names]
    position, turn, mapping = fit.spread
    data = {"version": VERSION, "board": str(board), "square_mm": round(1000 * board.square, 6),
            "ir_offset_px": _plain(offset), "error_px": round(fit.rms, 4), "refined_jointly": fit.jointly,
            "depth": _camera_record(fit.depth), "color": _camera_record(fit.color),
            "standard_deviations": {"translation_mm": _plain(1000 * position, 4),
                                    "rotation_deg": round(float(np.degrees(turn)), 5),
                                    "mapping_px": mapping if mapping is None else round(mapping, 4)},
            "warnings": list(warnings), "pairs": views}
    return ("# How this rig was calibrated, by calibrate_rig. error_px: RMS; of a pair in the depth and color picture.\n"
            + yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=120))
