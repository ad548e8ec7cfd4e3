# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags as scenes: every bracket is one, its frames exported to files, this package's modes run through the real nodes.

OUTPUT/bags/NAME/: MODE/bracket_0000/ as evaluate_bag writes it, stacks/bracket_0000/000.png and so on, bag.json.
"""
import json
from contextlib import closing
from pathlib import Path

import cv2

from all_in_focus import installed
from all_in_focus.bag.bag_file import BagContents, BagFile, Topics, load_topics
from all_in_focus.bag.brackets import Rules, assemble
from all_in_focus.bag.options import option_of
from all_in_focus.image_messages import bgr
from all_in_focus.bag.scan import scan
from all_in_focus.files.output_folder import whole_folder
from all_in_focus.files.stack import read_image
from all_in_focus_lab.benchmark.methods import OWN
from all_in_focus_lab.benchmark.scenes import Scene, digest

DONE = "bag.json"


def topics(options):
    """Topics by the options of evaluate_bag, such as {"topics": FILE, "depth-topic": "/camera/depth"}."""
    names = vars(load_topics(options["topics"]) if "topics" in options else Topics())
    return Topics(**{kind: options.get(option_of(kind)[2:]) or name for kind, name in names.items()})


def check_bag_scene(scene, options):
    """BagError where the nodes could not use the bag. Sets digest."""
    BagContents(scene.path, topics(options)).close()
    for path in scene.beside.values():
        read_image(path)
    scene.digest = digest([scene.path])


def prepare(scene, modes, options, folder, nodes):
    """Play the bag in each mode and export its brackets into `folder`; nodes: what the nodes are, see versions.

    Returns {"failed": mode -> one line, "scenes": one for each bracket}. Plays nothing where an earlier run with the same
    bag, modes, options and nodes succeeded.
    """
    named = vars(topics(options))  # a file may name them
    mark, failed = json.dumps([scene.digest, sorted(modes), options, named, nodes], sort_keys=True), {}
    try:
        is_done = (folder / DONE).read_text(encoding="utf-8") == mark
    except (OSError, ValueError):
        is_done = False
    if is_done:
        return {"failed": failed, "scenes": brackets(scene, modes, options, folder)}
    arguments = [part for name, value in options.items() for part in ("--" + name, value)]
    with whole_folder(folder, "evaluate", parents=True) as working:
        for mode in modes or OWN[:1]:  # without own methods, one run still tells the brackets
            try:
                installed.run([installed.find("evaluate_bag"), "--bag", scene.path, "--output", working / mode,
                               "--mode", mode, *arguments])  # without a time-out here: evaluate_bag has its own
            except (RuntimeError, OSError) as error:
                failed[mode] = str(error)
        worked = [mode for mode in modes or OWN[:1] if mode not in failed]
        if worked:
            export_frames(scene.path, options, working / worked[0], working / "stacks")
        if not failed:
            (working / DONE).write_text(mark, encoding="utf-8")
    return {"failed": failed, "scenes": brackets(scene, modes, options, folder)}


def export_frames(bag, options, results, folder):
    """Write the frames of each bracket to folder/bracket_0000/000.png and so on.

    options: of evaluate_bag, by name; results: folder with the reports of a run, one for each bracket. The frames of a
    bracket are found by the rules of the fusion node.
    """
    reports = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(Path(results).glob("bracket_*/report.json"))]
    rules = Rules(int(options.get("bracket-size", 0)), float(options.get("bracket-gap", 1.0)))
    with closing(BagFile(bag, topics(options))) as file:
        found = assemble(scan(file), rules, []).found
        for number, bracket in _of_reports(reports, found):
            target = Path(folder) / f"bracket_{number:04d}"
            target.mkdir(parents=True)
            for place, frame in enumerate(bracket.frames):
                cv2.imwrite(str(target / f"{place:03d}.png"), bgr(file.read_at(frame.head.place)))


def _of_reports(reports, found):
    """Yields (number of a report, its bracket). Both are in the order of the bag, but a bracket may have no report, and
    bags that were joined have the same bracket_id several times."""
    rest = list(found)
    has_focus = any(bracket.frames[0].focus for bracket in found)
    for number, report in enumerate(reports):
        same = [at for at, bracket in enumerate(rest) if not has_focus or bracket.number == report["bracket_id"]]
        alike = [at for at in same if len(rest[at].frames) == report["frames_seen"]]
        if same:
            at = (alike or same)[0]
            yield number, rest[at]
            del rest[:at + 1]


def brackets(scene, modes, options, folder):
    """A scene for each bracket that prepare() has exported."""
    found, stacks = [], sorted(folder.glob("stacks/*"))
    for stack in stacks:
        nodes = {mode: folder / mode / stack.name for mode in modes
                 if (folder / mode / stack.name / "fused.png").exists()}
        title = scene.name if len(stacks) == 1 else f"{scene.name}/{stack.name}"
        frames = [*sorted(stack.iterdir()), *scene.beside.values()]
        found.append(Scene(title, stack, stack, beside=scene.beside, of_bag=True, nodes=nodes,
                           digest=" ".join([digest(frames), scene.digest, json.dumps(options, sort_keys=True)])))
    return found
