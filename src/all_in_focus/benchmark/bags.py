# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags as scenes: every bracket is one, its frames exported to files, this package's modes run through the real nodes.

OUTPUT/bags/NAME/: MODE/bracket_0000/ as evaluate_bag writes it, stacks/bracket_0000/000.png and so on, bag.json.
"""
import json
import os
import shutil
from contextlib import closing

import cv2

from all_in_focus.bag.bag_file import BagFile
from all_in_focus.bag.brackets import Rules, assemble
from all_in_focus.bag.contents import BagContents, Topics
from all_in_focus.bag.image_messages import bgr
from all_in_focus.bag.scan import fetch, scan
from all_in_focus.benchmark import programs
from all_in_focus.benchmark.methods import OWN
from all_in_focus.benchmark.scenes import Scene, digest
from all_in_focus.files.stack import read_image

DONE = "bag.json"  # written last


def topics(options):
    """Topics by the options of evaluate_bag, such as {"depth-topic": "/camera/depth"}."""
    given = {kind: options.get(kind.replace("_", "-") + "-topic") for kind in vars(Topics())}
    return Topics(**{kind: name for kind, name in given.items() if name})


def check(scene, options):
    """BagError where the nodes could not use the bag. Sets digest."""
    BagContents(scene.path, topics(options)).close()
    for path in scene.beside.values():
        read_image(path)
    scene.digest = digest([scene.path])
    return scene


def fingerprint(scene, modes, options, fusion):
    return json.dumps([scene.digest, sorted(modes), options, fusion], sort_keys=True)


def prepare(scene, modes, options, folder, mark):
    """Play the bag in each mode and export its brackets into `folder`; mark: fingerprint, kept there.

    Returns {"failed": mode -> one line}; what is there already with the same mark is not made again.
    """
    path = os.path.join(folder, DONE)
    try:
        with open(path, encoding="utf-8") as file:
            done = json.load(file)
        if done["mark"] == mark and not done["failed"]:
            return done
    except (OSError, ValueError, KeyError):
        pass
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
    failed = {}
    arguments = [part for name, value in options.items() for part in ("--" + name, value)]
    for mode in modes or OWN[:1]:  # without any, still to learn what the brackets are
        try:
            programs.run([programs.find("evaluate_bag"), "--bag", scene.path, "--output", os.path.join(folder, mode),
                          "--mode", mode, *arguments])  # it gives up by itself where nothing goes on
        except (RuntimeError, OSError) as error:
            failed[mode] = str(error)
    worked = [mode for mode in modes or OWN[:1] if mode not in failed]
    if worked:
        export(scene.path, topics(options), os.path.join(folder, worked[0]), os.path.join(folder, "stacks"), options)
    with open(path, "w", encoding="utf-8") as file:
        json.dump({"mark": mark, "failed": failed}, file)
    return {"failed": failed}


def export(bag, names, results, folder, options):
    """Write the frames of each bracket to folder/bracket_0000/000.png and so on.

    results: folder with the reports of a run, which say what brackets there were; which frames belong to them is told
    as the nodes tell it. options: of evaluate_bag, by name.
    """
    reports = [_report(os.path.join(results, name)) for name in sorted(os.listdir(results))
               if name.startswith("bracket_")]  # beside them lies the mark of evaluate_bag
    rules = Rules(int(options.get("bracket-size", 0)), float(options.get("bracket-gap", 1.0)))
    with closing(BagFile(bag, names)) as file:
        found = assemble(scan(file), rules, []).found
        for number, bracket in _of_reports(reports, found):
            target = os.path.join(folder, f"bracket_{number:04d}")
            os.makedirs(target)
            for place, frame in enumerate(bracket.frames):
                cv2.imwrite(os.path.join(target, f"{place:03d}.png"), bgr(fetch(file, "rgb", frame.head)))


def _of_reports(reports, found):
    """(number of a report, its bracket): both are in the order of the bag, but of some brackets nothing was made, and
    joined bags have the same bracket_id several times."""
    rest = list(found)
    has_focus = any(bracket.frames[0].focus for bracket in found)
    for number, report in enumerate(reports):
        same = [at for at, bracket in enumerate(rest) if not has_focus or bracket.number == report["bracket_id"]]
        alike = [at for at in same if len(rest[at].frames) == report["frames_seen"]]
        if same:
            at = (alike or same)[0]
            yield number, rest[at]
            del rest[:at + 1]


def _report(folder):
    with open(os.path.join(folder, "report.json"), encoding="utf-8") as file:
        return json.load(file)


def brackets(scene, modes, options, folder):
    """A scene for each bracket that prepare() has exported."""
    stacks = os.path.join(folder, "stacks")
    names = sorted(os.listdir(stacks)) if os.path.isdir(stacks) else []
    found = []
    for name in names:
        nodes = {mode: os.path.join(folder, mode, name) for mode in modes
                 if os.path.exists(os.path.join(folder, mode, name, "fused.png"))}
        stack = os.path.join(stacks, name)
        title = scene.name if len(names) == 1 else f"{scene.name}/{name}"
        frames = [os.path.join(stack, frame) for frame in sorted(os.listdir(stack))]
        frames += scene.beside.values()
        found.append(Scene(title, stack, stack, beside=scene.beside, of_bag=True, nodes=nodes,
                           digest=" ".join([digest(frames), scene.digest, json.dumps(options, sort_keys=True)])))
    return found
