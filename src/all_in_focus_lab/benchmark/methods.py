# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Methods by name, as `evaluate --help` lists them.

A method is run(scene, folder) -> Produced; folder: an empty one to work in. An exception that it raises is reported as
its failure.
"""
import argparse
import json
import re
import shlex
import shutil
import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Dict, List, Optional

import cv2
import numpy as np
import yaml

from all_in_focus import installed
from all_in_focus.files import yaml_file
from all_in_focus.files.output_file import encode_png
from all_in_focus.files.rig import Optics, load_rig
from all_in_focus.files.stack import read_depth, read_image
from all_in_focus_lab.baselines import BASELINES
from all_in_focus_lab.baselines.alignment import align
from all_in_focus_lab.benchmark.scenes import digest
from all_in_focus_lab.metrics.truth import psnr
from all_in_focus_lab.simulation import lens

OWN = ("paper", "refined", "restored")
WRONG = r"aperture\*[0-9.]+|focus\*[0-9.]+|focus-(reversed|late|early)"
VARIANTS = re.compile(rf"-[a-z][a-z_-]*(,[a-z_-]+)*|frames|no-depth(\+({WRONG}))?|{WRONG}")
WRONG_LENS = [f"{factor}*{times}" for factor in ("aperture", "focus") for times in ("0.25", "0.5", "2", "4", "8")] + [
    "focus-reversed", "focus-late", "focus-early"]
TIMEOUT_S = 3600.0
PICTURES = ("source_index", "labels", "regions")  # as fuse_stack --save-NAME saves them
DEPTHS = ("measured", "registered", "depth")  # the same
KNOWN_DEPTH = {"depth": "--depth", "registered_depth": "--registered-depth", "label": "--label-map"}  # the first counts


@dataclass
class Produced:
    """fused: H x W x 3 uint8. winners: H x W uint16, frame with the most weight, 65535 = none; share: H x W, that of the second
    of two frames, 0..1, W of equation 11. labels: H x W uint16; regions: picture of them for people, BGR.
    seconds: from frames in memory to the fused image.
    depths: H x W uint16 mm, 0 = unknown, by DEPTHS: as measured, with filled holes, and what mode restored estimates.
    """
    fused: np.ndarray
    winners: Optional[np.ndarray] = None
    share: Optional[np.ndarray] = None
    labels: Optional[np.ndarray] = None
    regions: Optional[np.ndarray] = None
    seconds: Optional[float] = None
    notes: List[str] = field(default_factory=list)
    depths: Dict[str, np.ndarray] = field(default_factory=dict)


def available():
    """What `all` stands for: this package's modes and every baseline, enfuse where it is installed."""
    return list(OWN) + [name for name in BASELINES if name != "enfuse" or shutil.which("enfuse")]


def wrong_lens():
    """What `wrong-lens` stands for: each mode with right numbers, with wrong ones and without any; depth given or not."""
    right = ["refined", "refined:no-depth", "restored", "restored:no-depth", "restored:frames"]
    return right + [f"{mode}{wrong}" for mode in ("refined:", "restored:", "restored:no-depth+") for wrong in WRONG_LENS]


def expand(names, scenes, peers={}):
    """Names with `all` and `given:*` replaced by what there is; ValueError for a name that no method has, or twice."""
    given = ["given:" + name for name in dict.fromkeys(name for scene in scenes for name in scene.given)]
    wide = {"all": available(), "given:*": given, "wrong-lens": wrong_lens()}
    expanded = [name for wanted in names for name in wide.get(wanted, [wanted])]
    for name in expanded:
        find(name, peers)
        if expanded.count(name) > 1:
            raise ValueError(f"method '{name}' is named twice")
    return expanded


def find(name, peers={}, program=""):
    """The method of a name; ValueError if there is none.

    peers: more names -> command lines (see `peer_command`); program: path of fuse_stack, empty: that of this package.
    """
    kind, colon, variant = str(name).partition(":")
    plain = name[:-len("+ecc")] if name.endswith("+ecc") else name
    if name in peers:
        return partial(_peer, peers[name], name.endswith("+ecc"))
    if kind in OWN and (not colon or VARIANTS.fullmatch(variant)):
        return partial(_own, kind, variant, program)
    if plain in BASELINES:
        return partial(_baseline, plain, plain != name)
    if name in BOUNDS:
        return partial(_bound, name)
    if kind == "given" and re.fullmatch(r"[\w.-]+", variant):
        return partial(_given, variant)
    raise ValueError(f"no method is named '{name}'; there are {', '.join([*OWN, *BASELINES])}, each of the last "
                     f"{len(BASELINES)} with +ecc, {', '.join(BOUNDS)}, and given:NAME")


def split(text):
    """Names of a list a,b,refined:-c,d: after a minus sign commas go on until the next name of a method."""
    names = []
    for part in text.split(","):
        is_step = re.fullmatch("[a-z][a-z_-]*", part) and part not in {*OWN, *BASELINES, *BOUNDS, "all"}
        if names and ":-" in names[-1] and is_step:
            names[-1] += "," + part
        else:
            names.append(part)
    return names


def fingerprint(name, scene, versions, peers={}):
    """What a result depends on; versions: see versions.versions(); peers: see find()."""
    parts = [scene.digest, scene.optics, name, *([peers[name]] if name in peers else [])]
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
    return Produced(fused, *_decided(weights, fused.shape[:2], len(frames)), seconds=seconds)


def _decided(weights, shape, frames):
    """(winners, share) of Produced; weights: of each frame, N x H x W, or the share of the second of two; or None."""
    if weights is None:
        return None, None
    shares = np.asarray(weights)
    if shares.shape != (frames,) + shape and (frames, shares.shape) != (2, shape):
        raise ValueError(f"weights of shape {shares.shape} for {frames} frames of {shape[1]}x{shape[0]} pixels")
    if frames != 2:
        return np.argmax(shares, 0).astype(np.uint16), None
    share = shares if shares.shape == shape else shares[1] / np.maximum(shares.sum(0), 1e-9)
    return np.uint16(share > 0.5), share


def _given(name, scene, folder):
    if name not in scene.given:
        raise ValueError(f"{scene.path}: holds no fused_{name}.png")
    return Produced(read_image(scene.given[name]))


def peer_command(text):
    """argparse type: (name, command line) of NAME=COMMAND; {stack} {focus} {rig} {depth} {output} in it are replaced.

    The frames are aligned first if NAME ends with +ecc.
    """
    name, equals, command = text.partition("=")
    if not (name and equals and "{output}" in command) or "," in name:
        raise argparse.ArgumentTypeError(f"'{text}': expected NAME=COMMAND with {{output}} in it")
    return name, command


def _peer(command, aligned, scene, folder):
    """Somebody else's program, such as focus-stack or a learned method; without a file for a name, it gets ''."""
    output = Path(folder) / "fused.png"
    paths = {"stack": _aligned_stack(scene, folder) if aligned else _stack(scene, folder), "output": output,
             **{key: scene.beside.get(key, "") for key in ("focus", "rig", "depth")}}
    parts = [part.format(**paths) for part in shlex.split(command)]
    begin = time.perf_counter()
    installed.run(parts, TIMEOUT_S)
    if not output.exists():
        raise RuntimeError(f"{Path(parts[0]).name}: has not written {{output}}")
    return Produced(read_image(output), seconds=time.perf_counter() - begin)


def _own(mode, variant, program, scene, folder):
    if scene.of_bag:
        if variant:
            raise ValueError("steps are left out on files only, not in bags")
        if mode not in scene.nodes:
            raise ValueError("the nodes have made nothing of this bracket")
        return _read_own(scene.nodes[mode], "the fusion node alone", ("fusion",))
    installed.run(fuse_stack_command(mode, variant, program or installed.find("fuse_stack"), scene, folder), TIMEOUT_S)
    return _read_own(folder)


def fuse_stack_command(mode, variant, program, scene, folder):
    """Command line of fuse_stack for a scene, which writes fused.png, report.json and more into a folder."""
    folder, beside, optics = Path(folder), dict(scene.beside), scene.optics
    if variant == "frames":
        beside, optics = {}, ""
    if variant.startswith("no-depth"):
        hidden = set(KNOWN_DEPTH)
        if mode != "restored":
            hidden, optics = hidden | {"rig"}, ""
        beside = {key: path for key, path in beside.items() if key not in hidden}
    wrong = variant.rpartition("+")[2]
    if wrong.startswith("aperture*"):
        known = scene.lens()
        optics = str(replace(known, aperture=known.aperture * float(wrong[len("aperture*"):])))
    if wrong.startswith("focus"):
        changed = folder / "wrong_focus.yaml"
        write_wrong_focus(beside["focus"], wrong, changed)
        beside["focus"] = changed
    depth = next((key for key in KNOWN_DEPTH if key in beside), None)
    options = {"--without": variant[1:] if variant.startswith("-") else "", "--rig": beside.get("rig"), "--optics": optics,
               "--focus": beside.get("focus")}
    if depth:
        options[KNOWN_DEPTH[depth]] = beside[depth]
    command = [program, "--mode", mode, "--stack", _stack(scene, folder), "--output", folder / "fused.png", "--report",
               folder / "report.json", *(part for option, value in options.items() if value for part in (option, value))]
    saved = list(PICTURES[:{None: 1, "label": 2}.get(depth, 3)])  # regions: where their depth is known
    if {"rig", "depth"} <= set(beside):
        saved += DEPTHS[:2]
    if mode == "restored" and {"rig", "focus"} <= set(beside):  # else it is refined
        saved.append(DEPTHS[2])
    for name in saved:
        command += ["--save-" + name.replace("_", "-"), folder / f"{name}.png"]
    return [str(part) for part in command]


def write_wrong_focus(path, wrong, output):
    """Writes focus distances with a mistake of WRONG_LENS."""
    data = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    dioptres = [1 / frame["focus_mm"] for frame in data["frames"]]
    if wrong == "focus-reversed":
        dioptres.reverse()
    elif wrong == "focus-late":
        dioptres = [2 * dioptres[0] - dioptres[1], *dioptres[:-1]]
    elif wrong == "focus-early":
        dioptres = [*dioptres[1:], 2 * dioptres[-1] - dioptres[-2]]
    else:
        dioptres = [one / float(wrong[len("focus*"):]) for one in dioptres]
    for frame, one in zip(data["frames"], dioptres):
        frame["focus_mm"] = 1 / max(one, 1e-6)
    yaml_file.write(output, data)


def _stack(scene, folder):
    """Folder or video of the frames; where a folder holds other pictures too, one that links just these."""
    if scene.stack:
        return scene.stack
    linked = Path(folder) / "stack"
    linked.mkdir()
    for path in scene.sources:
        (linked / path.name).symlink_to(path.absolute())
    return linked


def _aligned_stack(scene, folder):
    """Folder of the aligned frames, as PNG under the names that {focus} has where the frames are PNG, too."""
    made = Path(folder) / "aligned"
    made.mkdir()
    for name, frame in zip(scene.names(), align(list(scene.frames()))):
        (made / name).with_suffix(".png").write_bytes(encode_png(frame))
    return made


# --- bounds: they know the truth --------------------------------------------------------------------------------------

def _bound(name, scene, folder):
    if "truth" not in scene.beside:
        raise ValueError(f"{scene.path}: no truth is known, which {name} needs")
    return BOUNDS[name](scene)


def single(scene):
    """The best frame as it is."""
    truth = read_image(scene.beside["truth"])
    return Produced(max(scene.frames(), key=lambda frame: psnr(frame, truth)))


def oracle(scene):
    """Every pixel from the frame whose colour is nearest to the truth there."""
    truth = read_image(scene.beside["truth"]).astype(np.int32)
    fused, index = np.zeros(truth.shape, np.uint8), np.zeros(truth.shape[:2], np.uint16)
    best = np.full(index.shape, np.inf)
    for number, frame in enumerate(scene.frames()):
        error = ((frame - truth) ** 2).sum(axis=2)
        better = error < best
        fused[better], best[better], index[better] = frame[better], error[better], number
    return Produced(fused, index)


def true_depth(scene):
    """Every pixel from the frame focused nearest, in dioptres, to the true depth; true motion is undone, but not a drift."""
    made = json.loads((scene.path / "scene.json").read_text(encoding="utf-8"))
    camera, depth = load_rig(scene.beside["rig"]).color, read_depth(scene.beside["truth_depth"])
    focus, sag = np.array(made["focus_mm"]), lens.Sag(**made.get("sag", {}))
    index = np.argmin([np.abs(1 / s - 1 / np.maximum(depth, 1)) for s in focus], axis=0)
    sag = replace(sag, right_px=sag.right_px * scene.enlarge, down_px=sag.down_px * scene.enlarge)
    motions = lens.frame_motions(camera, Optics(**made["optics"]), focus, made["breathing"], sag)
    fused = np.zeros(depth.shape + (3,), np.uint8)
    for number, (frame, matrix) in enumerate(zip(scene.frames(), motions)):
        still = lens.warp(np.float32(frame), cv2.invertAffineTransform(matrix))
        fused[index == number] = np.uint8(np.clip(np.rint(still), 0, 255))[index == number]
    return Produced(fused, index.astype(np.uint16))


BOUNDS = {"single": single, "oracle": oracle, "true-depth": true_depth}


# --- results ----------------------------------------------------------------------------------------------------------


def _read_own(folder, measured="", steps=None):
    """Result of fuse_stack or of the nodes. steps: which of the report's times count; measured: a note about the time."""
    report = json.loads(Path(folder, "report.json").read_text(encoding="utf-8"))
    paths = {name: Path(folder, f"{name}.png") for name in ("fused", *PICTURES, *DEPTHS)}
    images = {name: read_image(path, cv2.IMREAD_UNCHANGED) for name, path in paths.items() if path.exists()}
    times = dict(zip(report["timing_names"], report["timing_ms"]))
    return Produced(images["fused"], images.get("source_index"), None, images.get("labels"), images.get("regions"),
                    sum(ms for name, ms in times.items() if steps is None or name in steps) / 1000,
                    report["notes"] + (["time: " + measured] if measured else []),
                    {name: images[name] for name in DEPTHS if name in images})
