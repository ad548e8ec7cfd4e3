# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Methods by name: paper and refined (this package; through the nodes where the scene is a bag), every baseline, each
baseline with +ecc (frames aligned first), and given:NAME (an image fused_NAME.png that lies beside the sources).

A method is run(scene, folder) -> Produced; folder: an empty one to work in. Whatever it raises is its failure.
"""
import json
import os
import re
import shutil
import time
from dataclasses import dataclass, field
from functools import partial
from typing import List, Optional

import cv2
import numpy as np

from all_in_focus.baselines import BASELINES
from all_in_focus.baselines.alignment import align
from all_in_focus.benchmark import programs
from all_in_focus.benchmark.scenes import digest
from all_in_focus.files.stack import read_image

OWN = ("paper", "refined")
TIMEOUT_S = 3600.0
PICTURES = ("source_index", "labels")


@dataclass
class Produced:
    """fused: H x W x 3 uint8. weights: H x W, uint16: frame with the most weight, 65535 = none; or float: share of
    the second of two frames, W of equation 11. labels: H x W uint16. seconds: from frames in memory to the fused image.
    """
    fused: np.ndarray
    weights: Optional[np.ndarray] = None
    labels: Optional[np.ndarray] = None
    seconds: Optional[float] = None
    notes: List[str] = field(default_factory=list)

    def winners(self):
        """H x W, number of the frame with the most weight, 65535 = none; None where the method does not tell."""
        if self.weights is not None and np.issubdtype(self.weights.dtype, np.floating):
            return np.uint16(self.weights > 0.5)
        return self.weights


def available():
    """What `all` stands for: this package's modes and every baseline, enfuse where it is installed."""
    return list(OWN) + [name for name in BASELINES if name != "enfuse" or shutil.which("enfuse")]


def expand(names, scenes):
    """Names with `all` and `given:*` replaced by what there is; ValueError for a name that no method has, or twice."""
    given = ["given:" + name for name in dict.fromkeys(name for scene in scenes for name in scene.given)]
    wide = {"all": available(), "given:*": given}
    expanded = [name for wanted in names for name in wide.get(wanted, [wanted])]
    for name in expanded:
        find(name)
        if expanded.count(name) > 1:
            raise ValueError("method '%s' is named twice" % name)
    return expanded


def find(name):
    """The method of a name; ValueError if there is none."""
    mode, colon, without = str(name).partition(":")
    plain = name[:-len("+ecc")] if name.endswith("+ecc") else name
    if mode in OWN and (not colon or re.fullmatch(r"-[a-z][a-z-]*(,[a-z-]+)*", without)):
        return partial(_own, mode, without[1:])
    if plain in BASELINES:
        return partial(_baseline, plain, plain != name)
    if mode == "given" and re.fullmatch(r"[\w.-]+", without):
        return partial(_given, without)
    raise ValueError("no method is named '%s'; there are %s, each of the last %d with +ecc, and given:NAME"
                     % (name, ", ".join(OWN + tuple(BASELINES)), len(BASELINES)))


def split(text):
    """Names of a list a,b,refined:-c,d: after a minus sign commas go on until the next name of a method."""
    names = []
    for part in text.split(","):
        if names and ":-" in names[-1] and re.fullmatch("[a-z][a-z_-]*", part) and part not in (*OWN, *BASELINES, "all"):
            names[-1] += "," + part
        else:
            names.append(part)
    return names


def fingerprint(name, scene, versions):
    """What a result depends on; versions: see programs."""
    parts = [scene.digest, scene.optics, name]
    if name.startswith("given:"):
        path = scene.given.get(name.partition(":")[2])
        parts.append(digest([path]) if path else "")
    program = [versions["nodes" if scene.of_bag else "fuse_stack"]] * (name.partition(":")[0] in OWN)
    return " ".join([*parts, versions["code"], *program])


def _baseline(name, aligned, scene, folder):
    frames = list(scene.frames())
    begin = time.perf_counter()
    fused, weights = BASELINES[name](align(frames) if aligned else frames)
    seconds = time.perf_counter() - begin
    return Produced(fused, _checked_weights(weights, fused.shape[:2], len(frames)), seconds=seconds)


def _checked_weights(weights, shape, frames):
    """Weights as Produced has them; a share for each frame (N x H x W) becomes one of both forms."""
    if weights is None or np.shape(weights) == shape:
        return weights
    shares = np.asarray(weights)
    if shares.shape != (frames,) + shape:
        raise ValueError("weights of shape %s for %d frames of %dx%d pixels" % (shares.shape, frames, *shape[::-1]))
    return shares[1] / np.maximum(shares.sum(0), 1e-9) if frames == 2 else np.argmax(shares, 0).astype(np.uint16)


def _given(name, scene, folder):
    if name not in scene.given:
        raise ValueError("%s: holds no fused_%s.png" % (scene.path, name))
    return Produced(read_image(scene.given[name]))


def _own(mode, without, scene, folder):
    if scene.of_bag:
        if without:
            raise ValueError("steps are left out on files only, not in bags")
        if mode not in scene.nodes:
            raise ValueError("the nodes have made nothing of this bracket")
        return _read_own(scene.nodes[mode], "the fusion node alone", ("fusion",))
    stack = scene.stack or _linked(scene.sources, os.path.join(folder, "stack"))
    command = [programs.find("fuse_stack"), "--mode", mode, "--stack", stack, *_known(scene),
               "--output", os.path.join(folder, "fused.png"), "--report", os.path.join(folder, "report.json")]
    has_labels = {"depth", "registered_depth", "label"} & set(scene.beside)
    for name in PICTURES if has_labels else PICTURES[:1]:
        command += ["--save-" + name.replace("_", "-"), os.path.join(folder, name + ".png")]
    programs.run(command + ["--without", without] * bool(without), TIMEOUT_S)
    return _read_own(folder)


def _known(scene):
    """Arguments of fuse_stack for what is known beside the frames."""
    beside, arguments = scene.beside, []
    if "rig" in beside:
        arguments += ["--rig", beside["rig"]]
    if scene.optics:
        arguments += ["--optics", scene.optics]
    if "focus" in beside:
        arguments += ["--focus", beside["focus"]]
    for key, option in (("depth", "--depth"), ("registered_depth", "--registered-depth"), ("label", "--label-map")):
        if key in beside:
            return arguments + [option, beside[key]]
    return arguments


def _linked(sources, folder):
    """A folder that holds just these pictures, under their own names."""
    os.mkdir(folder)
    for path in sources:
        os.symlink(os.path.abspath(path), os.path.join(folder, os.path.basename(path)))
    return folder


def _read_own(folder, remark="", steps=None):
    """What fuse_stack or the nodes have written; steps: which of the report's times count."""
    with open(os.path.join(folder, "report.json"), encoding="utf-8") as file:
        report = json.load(file)
    images = {name: read_image(os.path.join(folder, name + ".png"), cv2.IMREAD_UNCHANGED)
              for name in ("fused",) + PICTURES if os.path.exists(os.path.join(folder, name + ".png"))}
    times = dict(zip(report["timing_names"], report["timing_ms"]))
    return Produced(images["fused"], images.get("source_index"), images.get("labels"),
                    sum(ms for name, ms in times.items() if steps is None or name in steps) / 1000,
                    report["notes"] + (["time: " + remark] if remark else []))
