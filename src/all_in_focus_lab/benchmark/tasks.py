# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One method on one scene, fused and measured: what is handed to other processes and machines."""
import platform
import tempfile
import time

import numpy as np

from all_in_focus.files.output_file import encode_png
from all_in_focus.files.rig import load_rig
from all_in_focus.files.stack import load_focus, read_depth, read_image, size_text
from all_in_focus_lab import metrics
from all_in_focus_lab.benchmark import methods, versions
from all_in_focus_lab.metrics.kept_contrast import kept_contrast, roughness
from all_in_focus_lab.metrics.truth import Truth, blur_per_inverse_depth, depth_errors, psnr, ssim


def run(scene, method, metric_names, code, peers, program):
    """Plain dictionary: values, contrast, depths, seconds, wall_seconds, host, notes, files (PNG bytes by name).

    peers, program: see methods.find; code: versions.code_digest() of the caller; a worker with another version of the
    package refuses.
    """
    if versions.code_digest() != code:
        raise RuntimeError(f"{platform.node()} has another version of the package")
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="evaluate.") as folder:
        produced = methods.find(method, peers, program)(scene, folder)
    wall = time.perf_counter() - begin
    frames = list(scene.frames())
    return {"values": measure(scene, frames, produced.fused, metric_names), "contrast": measure_contrast(frames, produced),
            "depths": measure_depths(scene, produced.depths), "seconds": produced.seconds, "wall_seconds": wall,
            "host": platform.node(), "notes": produced.notes, "files": pictures(produced)}


def measure_contrast(frames, produced):
    """Name -> value of CONTRAST_MEASURES; roughness is None where the method does not tell who won."""
    shares = kept_contrast(frames, produced.fused)
    return {"kept_contrast": float(np.mean(shares)), "kept_contrast_least": min(shares),
            "roughness": None if produced.winners is None else roughness(produced.winners)}


def measure(scene, frames, fused, metric_names):
    """Name -> value of the metrics, and with a truth of TRUTH_MEASURES. ValueError where sizes differ."""
    if fused.shape[:2] != frames[0].shape[:2]:
        raise ValueError(f"the fused image has {size_text(fused)} pixels, the frames have {size_text(frames[0])}")
    names = [name for name in metric_names if name in metrics.METRICS]
    return {**metrics.evaluate(frames, fused, names), **measure_truth(scene, fused)}


def measure_truth(scene, fused):
    """Name -> value of TRUTH_MEASURES; nothing without a truth, no PSNR_edges where it has no edges."""
    if "truth" not in scene.beside:
        return {}
    depth = read_depth(scene.beside["truth_depth"]) if "truth_depth" in scene.beside else None
    truth = Truth.of(read_image(scene.beside["truth"]), depth, scene.lens(), scene.enlarge)
    colour = truth.compared(fused)
    values = {"PSNR": psnr(colour, truth.image), "SSIM": ssim(colour, truth.image)}
    if truth.edges.any():
        values["PSNR_edges"] = psnr(colour, truth.image, truth.edges)
    return values


def measure_depths(scene, depths):
    """Name -> (share wrong, RMSE) of metrics.truth.depth_errors; nothing where truth, lens or focus distances are unknown."""
    if not depths or not {"truth_depth", "rig", "focus"} <= set(scene.beside):
        return {}
    true = read_depth(scene.beside["truth_depth"])
    focus = [1000 * distance for distance in load_focus(scene.beside["focus"], scene.names(), len(scene.names()))]
    blur = blur_per_inverse_depth(scene.lens(), load_rig(scene.beside["rig"]).color.K[0, 0], focus)
    return {name: depth_errors(depth, true, blur) for name, depth in depths.items()}


def pictures(produced):
    """PNG bytes by name: fused, weights (16 bit: 65535 = all of the second frame) or source_index, labels, regions."""
    files = {"fused": encode_png(produced.fused)}
    if produced.share is not None:
        files["weights"] = encode_png(np.rint(np.clip(produced.share, 0, 1) * 65535).astype(np.uint16))
    elif produced.winners is not None:
        files["source_index"] = encode_png(produced.winners)
    if produced.labels is not None:
        files["labels"] = encode_png(produced.labels.astype(np.uint16))
    if produced.regions is not None:
        files["regions"] = encode_png(produced.regions)
    return files
