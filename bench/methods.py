# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The methods that bench/quality.py compares: functions (scene folder, path of the result) -> None, by name.

They raise ValueError, RuntimeError or OSError where they fail. Images are H x W x 3 uint8 (BGR).
"""
import json
import os
import re
import shlex
import subprocess
import tempfile
from functools import partial

import cv2
import numpy as np

from all_in_focus.simulation import lens
from all_in_focus.baselines import BASELINES
from all_in_focus.baselines.alignment import align
from all_in_focus.metrics.truth import psnr
from all_in_focus.files.rig import Optics, load_rig
from all_in_focus.files.stack import Stack, read_depth, read_image

TIMEOUT_S = 3600


def inputs(scene):
    """Paths of what a method may see."""
    names = {"stack": "stack", "focus": "focus.yaml", "rig": "rig", "depth": "depth.png"}
    return {key: os.path.join(scene, name) for key, name in names.items()}


def frames_of(scene):
    return list(Stack(inputs(scene)["stack"]))


def truth_of(scene):
    return read_image(os.path.join(scene, "truth.png"))


# --- bounds: they know the truth -------------------------------------------------------------------------------------

def single(scene):
    """The best frame as it is."""
    truth = truth_of(scene)
    return max(frames_of(scene), key=lambda frame: psnr(frame, truth))


def oracle(scene):
    """Every pixel from the frame whose colour is nearest to the truth there."""
    frames, truth = np.stack(frames_of(scene)), truth_of(scene).astype(np.int32)
    index = np.argmin([((frame - truth) ** 2).sum(axis=2) for frame in frames], axis=0)
    return np.take_along_axis(frames, index[None, ..., None], axis=0)[0]


def true_depth(scene):
    """Every pixel from the frame focused nearest, in dioptres, to the true depth; true motion is undone."""
    camera, depth = load_rig(inputs(scene)["rig"]).color, read_depth(os.path.join(scene, "truth_depth.png"))
    with open(os.path.join(scene, "scene.json"), encoding="utf-8") as file:
        made = json.load(file)
    focus = np.array(made["focus_mm"])
    index = np.argmin(np.abs(1 / focus[:, None, None] - 1 / np.maximum(depth, 1)), axis=0)
    roll, right, down = (made.get("sag", {}).get(key, 0) for key in ("roll_degrees", "right_px", "down_px"))
    enlarge = made.get("enlarge", 1)
    motions = lens.frame_motions(camera, Optics(**made["optics"]), focus, made["breathing"],
                                 lens.Sag(roll, right * enlarge, down * enlarge))
    fused = np.zeros(depth.shape + (3,), np.uint8)
    for number, (frame, matrix) in enumerate(zip(frames_of(scene), motions)):
        still = lens.warp(np.float32(frame), cv2.invertAffineTransform(matrix))
        frame = np.uint8(np.clip(np.rint(still), 0, 255))
        fused[index == number] = frame[index == number]
    return fused


BOUNDS = {"single": single, "oracle": oracle, "true-depth": true_depth}


def save(make, scene, output):
    cv2.imwrite(output, make(scene))


def baseline(name, aligned, scene):
    frames = frames_of(scene)
    return BASELINES[name](align(frames) if aligned else frames)[0]


# --- programs --------------------------------------------------------------------------------------------------------

def run(command, output):
    """Run a program that must write `output`."""
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True,
                            errors="replace", timeout=TIMEOUT_S)
    said = result.stdout.strip().splitlines() or ["exit code %d" % result.returncode]
    if result.returncode or not os.path.exists(output):
        raise RuntimeError("%s: %s" % (os.path.basename(command[0]), said[-1]))


def peer(template, scene, output):
    """A command line with {stack}, {focus}, {rig}, {depth} and {output} in it."""
    run([part.format(output=output, **inputs(scene)) for part in shlex.split(template)], output)


def fuse_stack(program, mode, variant, scene, output):
    """The package's own tool; variants: see `VARIANTS`."""
    given, extra = inputs(scene), []
    with tempfile.TemporaryDirectory() as folder:
        if variant.startswith("-"):
            extra = ["--without", variant[1:]]
        elif variant == "no-depth":
            del given["depth"], given["rig"]
        elif variant.startswith("optics"):
            optics = load_rig(given["rig"]).optics
            longer = optics.focal_length_mm * (1 + float(variant[6:]) / 100)
            extra = ["--optics", "%.9g,%.9g,%.9g" % (longer, optics.aperture, optics.circle_of_confusion_mm)]
        elif variant.startswith("shift"):
            given["depth"] = os.path.join(folder, "depth.png")
            shifted(inputs(scene)["depth"], int(variant[5:]), given["depth"])
        options = [part for name, path in given.items() for part in ("--" + name, path)]
        run([program, *options, "--mode", mode, "--output", output, *extra], output)


def shifted(path, columns, output):
    """Write a depth image moved to the right; what comes in from the left is unknown."""
    depth = read_depth(path)
    moved = np.zeros_like(depth)
    moved[:, columns:] = depth[:, :depth.shape[1] - columns]
    cv2.imwrite(output, moved)


OWN = ("paper", "refined")
# -a,b: without those steps; no-depth; optics+20: a focal length 20 % too long; shift5: depth 5 pixels to the right.
VARIANTS = re.compile(r"-[a-z][a-z_,-]*|no-depth|optics[+-][0-9]{1,2}|shift[0-9]{1,3}")


def find(name, program, peers):
    """The method of a name. program: path of fuse_stack; peers: name -> command line. ValueError if there is none."""
    kind, _, variant = name.partition(":")
    plain, aligned = (name[:-4], True) if name.endswith("+ecc") else (name, False)
    if name in peers:
        return partial(peer, peers[name])
    if name in BOUNDS:
        return partial(save, BOUNDS[name])
    if plain in BASELINES:
        return partial(save, partial(baseline, plain, aligned))
    if kind in OWN and (name == kind or VARIANTS.fullmatch(variant)):
        return partial(fuse_stack, program, kind, variant)
    raise ValueError("no method is named '%s'; there are %s, each of the last %d with +ecc"
                     % (name, ", ".join([*BOUNDS, *OWN, *BASELINES]), len(BASELINES)))


def split(text):
    """Names of a list a,b,refined:-c,d: after a minus sign commas go on until the next name of a method."""
    names = []
    for part in text.split(","):
        if names and ":-" in names[-1] and re.fullmatch("[a-z][a-z_-]*", part) and part not in known():
            names[-1] += "," + part
        else:
            names.append(part)
    return names


def known():
    return {*BOUNDS, *BASELINES, *OWN}
