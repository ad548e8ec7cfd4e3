# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags as scenes: every bracket is one, its frames exported to files, this package's modes run through the real nodes.

OUTPUT/bags/NAME/: MODE/bracket_0000/ as evaluate_bag writes it, stacks/bracket_0000/000.png and so on, bag.json.
"""
import json
import os
import shutil

import cv2

from all_in_focus.bag.contents import BagContents, Topics
from all_in_focus.bag.image_messages import bgr
from all_in_focus.benchmark import programs
from all_in_focus.benchmark.methods import OWN, TIMEOUT_S
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
                          "--mode", mode, *arguments], TIMEOUT_S)
        except (RuntimeError, OSError) as error:
            failed[mode] = str(error)
    worked = [mode for mode in modes or OWN[:1] if mode not in failed]
    if worked:
        export(scene.path, topics(options), os.path.join(folder, worked[0]), os.path.join(folder, "stacks"))
    with open(path, "w", encoding="utf-8") as file:
        json.dump({"mark": mark, "failed": failed}, file)
    return {"failed": failed}


def export(bag, names, results, folder):
    """Write the frames of each bracket to folder/bracket_0000/000.png and so on.

    results: folder with the reports of a run, which say how many frames each bracket had; frames of a bag with focus
    messages go by their bracket_id, all others in the order of the bag.
    """
    reports = [_report(os.path.join(results, name)) for name in sorted(os.listdir(results))]
    contents = BagContents(bag, names)
    try:
        brackets = {message.header.stamp: message.bracket_id for kind, message, _ in contents.messages()
                    if kind == "focus"}
        places = _Places(reports, bool(brackets))
        for kind, message, _ in contents.messages():
            place = places.of(brackets.get(message.header.stamp)) if kind == "rgb" else None
            if place is not None:
                target = os.path.join(folder, "bracket_%04d" % place[0])
                os.makedirs(target, exist_ok=True)
                cv2.imwrite(os.path.join(target, "%03d.png" % place[1]), bgr(message))
    finally:
        contents.close()


class _Places:
    """Where the frames go, one after the other."""

    def __init__(self, reports, has_focus):
        self._ids = {report["bracket_id"]: number for number, report in enumerate(reports)} if has_focus else None
        self._room = [report["frames_seen"] for report in reports]
        self._count = [0] * len(reports)

    def of(self, bracket_id):
        """(bracket, frame), both from 0; None for a frame of no bracket."""
        if self._ids is not None:
            number = self._ids.get(bracket_id)
        else:
            number = next((n for n, room in enumerate(self._room) if self._count[n] < room), None)
        if number is None:
            return None
        self._count[number] += 1
        return number, self._count[number] - 1


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
        title = scene.name if len(names) == 1 else "%s/%s" % (scene.name, name)
        frames = [os.path.join(stack, frame) for frame in sorted(os.listdir(stack))]
        frames += scene.beside.values()
        found.append(Scene(title, stack, stack, beside=scene.beside, of_bag=True, nodes=nodes,
                           digest=" ".join([digest(frames), scene.digest, json.dumps(options, sort_keys=True)])))
    return found
