# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The whole evaluation: find and check scenes, run what is not done yet, collect."""
import json
import os
import sys
import time
from pathlib import Path
from urllib.parse import quote

from all_in_focus.files.errors import one_line
from all_in_focus.files.output_file import write_picture
from all_in_focus.files.output_folder import whole_folder
from all_in_focus.progress import Progress
from all_in_focus_lab.benchmark import methods, scenes, tasks, versions
from all_in_focus_lab.benchmark.engine import engine
from all_in_focus_lab.benchmark.output_files import Run

RESULT = "result.json"  # of a method on a scene, written last; Python's JSON, which has NaN and Infinity


class BadInput(ValueError):
    """args: what is wrong, one line each."""


class Store:
    """Results on disk, OUTPUT/results/SCENE/METHOD/: each is there as a whole or not at all, so that a run can go on where an
    earlier one was interrupted."""

    def __init__(self, output):
        self.folder = Path(output) / "results"
        self.folder.mkdir(parents=True, exist_ok=True)

    def path(self, scene, method, name=""):
        """Of a result's folder, or a file in it."""
        return self.folder / scene / method / name

    def load(self, scene, method, fingerprint, metric_names):
        """A result of the same fingerprint that has these metrics, or None."""
        try:
            result = json.loads(self.path(scene, method, RESULT).read_text(encoding="utf-8"))
            same = result["fingerprint"] == fingerprint and set(metric_names) <= {*result["values"], *result["contrast"]}
            return result if same and self.path(scene, method, "fused.png").exists() else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def save(self, scene, method, fingerprint, run, result):
        """Writes what tasks.run has returned, in place of an older one; run: name of this run. Returns what load would.

        A failure leaves the folder empty: the next run tries again.
        """
        plain = {key: value for key, value in result.items() if key != "files"}
        plain.update(fingerprint=fingerprint, run=run)
        with whole_folder(self.path(scene, method), "evaluate", parents=True) as working:
            for name, data in result.get("files", {}).items():
                (working / f"{name}.png").write_bytes(data)
            if "error" not in result:
                (working / RESULT).write_text(json.dumps(plain, indent=2), encoding="utf-8")
        return plain

    def picture(self, scene, method, name):
        """Path of a picture of a result, None if it has none."""
        path = self.path(scene, method, f"{name}.png")
        return path if path.exists() else None

    def address(self, scene, method):
        """Of the fused picture of a result, relative to OUTPUT."""
        return quote(f"results/{scene}/{method}/fused.png")

    def keep(self, scene, title, image):
        """Writes a picture of a scene beside the results; returns its address, relative to OUTPUT."""
        name = f"pictures/{scene}/{Path(title).stem}.png"
        path = self.folder.parent / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_picture(path, image)
        return quote(name)


def find_scenes(settings):
    """All scenes, checked. BadInput with a line for each that cannot be used."""
    found, wrong = [], []
    for entry in settings.scenes:
        try:
            found += scenes.find(entry)
        except ValueError as error:
            wrong.append(str(error))
    names = [scene.name for scene in found]
    wrong += [f"two scenes are named {name}: give one of them a name" for name in sorted(set(names))
              if names.count(name) > 1]
    for scene in Progress(found, desc="check", unit="scene"):
        try:
            if scene.is_bag:
                from all_in_focus_lab.benchmark import bags  # with rosbag behind it
                bags.check_bag_scene(scene, settings.bag)
            else:
                scenes.check_scene(scene)
        except (OSError, ValueError) as error:
            wrong.append(one_line(error, scene.path))
    if wrong:
        raise BadInput(*wrong)
    return found


def evaluate(settings, fresh=False, say=lambda line: None):
    """Run (see output_files.Run) and Store of checked settings. say(line): called for every failure and every lost
    worker; fresh: ignore results of earlier runs. Raises ValueError (BadInput of scenes), engine.EngineError."""
    found = find_scenes(settings)
    names = methods.expand([*settings.methods, *settings.peers], found, settings.peers)
    Path(settings.output).mkdir(parents=True, exist_ok=True)
    name = f"{time.strftime('%Y-%m-%dT%H:%M:%S')} {os.getpid()}"
    run = Run(settings, [], names, {}, [], versions.versions(settings.fuse_stack), name)
    store = Store(settings.output)

    def print_line(line):
        with Progress.external_write_mode(file=sys.stderr):
            say(line)

    def fail(line):
        run.failures.append(line)
        print_line(line)

    with engine(settings.jobs, settings.scheduler, say=print_line) as workers:
        run.at_a_time = workers.at_a_time
        run.scenes = _with_brackets(found, names, settings, workers, run.versions["nodes"], fail)
        _run_tasks(run, store, workers, fresh, fail)
    return run, store


def _with_brackets(found, names, settings, workers, nodes, fail):
    """The scenes, each bag replaced by its brackets."""
    recorded = [scene for scene in found if scene.is_bag]
    if not recorded:
        return found
    from all_in_focus_lab.benchmark import bags
    modes = [name for name in names if name in methods.OWN]
    calls = {scene.name: (bags.prepare, (scene, modes, settings.bag, Path(settings.output, "bags", scene.name), nodes))
             for scene in recorded}
    brackets = {}
    for name, result in Progress(workers.run(calls), total=len(calls), desc="bags", unit="bag"):
        for mode, reason in result.get("failed", {}).items():
            fail(f"{name} {mode}: {reason}")
        if "error" in result:
            fail(f"{name}: {result['error']}")
        brackets[name] = result.get("scenes", [])
    return [one for scene in found for one in brackets.get(scene.name, [scene])]


def _run_tasks(run, store, workers, fresh, fail):
    """Every method on every scene, unless its result is there already."""
    by_name = {scene.name: scene for scene in run.scenes}
    marks = {(scene, method): methods.fingerprint(method, by_name[scene], run.versions, run.settings.peers)
             for scene in by_name for method in run.methods}
    done = {key: None if fresh else store.load(*key, mark, run.settings.metrics) for key, mark in marks.items()}
    asked = run.settings.metrics, run.versions["code"], run.settings.peers, run.settings.fuse_stack
    calls = {key: (tasks.run, (by_name[key[0]], key[1], *asked)) for key, result in done.items() if result is None}
    with Progress(total=len(marks), initial=len(marks) - len(calls), unit="result") as bar:
        for key, result in workers.run(calls):
            bar.set_description(" ".join(key))
            done[key] = store.save(*key, marks[key], run.name, result)
            if "error" in result:
                fail(f"{' '.join(key)}: {result['error']}")
            bar.update()
    run.results = {scene: {method: done[scene, method] for method in run.methods} for scene in by_name}
