# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The output files of evaluate: results.csv, scores.csv, results.json, report.html, configuration.yaml."""
import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List

from all_in_focus.files.output_file import whole_file
from all_in_focus_lab.benchmark import tables as t
from all_in_focus_lab.benchmark.page import page
from all_in_focus_lab.benchmark.scenes import Scene
from all_in_focus_lab.benchmark.settings import Settings

VERSION = 1  # of results.json


@dataclass
class Run:
    """One evaluation. results: scene -> method -> what Store has, {"error": ...} where it failed; failures: one line
    each; at_a_time: tasks that ran side by side; name: unique to this run."""
    settings: Settings
    scenes: List[Scene]
    methods: List[str]
    results: Dict[str, Dict[str, dict]]
    failures: List[str]
    versions: Dict[str, str]
    name: str = ""
    at_a_time: int = 1

    @property
    def timing_note(self):
        """How far the times can be compared."""
        good = [result for of in self.results.values() for result in of.values() if "error" not in result]
        hosts = sorted({result["host"] for result in good})
        notes = [f"Measured on {', '.join(hosts)}."] if hosts else []
        if len(hosts) > 1:
            notes.append("Not one machine: compare with care.")
        if self.at_a_time > 1:
            notes.append(f"{self.at_a_time} tasks ran side by side: times are longer than of one alone.")
        if any(result["run"] != self.name for result in good):
            notes.append("Some are of an earlier run.")
        return " ".join(notes)


def write(run, store, keep=None):
    """Write everything; each file takes the place of an older one at once. Returns the tables.

    keep: path of the configuration that the run has read, or None. Where it lies in the output folder it stays as it is.
    """
    tables = t.build(run.results, run.methods, run.settings.metrics)
    files = {"results.csv": results_csv(run), "scores.csv": scores_csv(tables), "results.json": as_json(run, tables),
             "configuration.yaml": run.settings.as_yaml(), "report.html": page(run, tables, store)}
    for name, text in files.items():
        path = Path(run.settings.output, name)
        if keep and path.exists() and path.samefile(keep):
            continue
        with whole_file(path) as working, working.open("w", encoding="utf-8", newline="") as file:
            file.write(text)
    return tables


def _csv(lines):
    """Numbers to the last bit, None as nothing."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue()


def results_csv(run):
    """A line for each scene and method."""
    found = {name for of in run.results.values() for result in of.values() for name in result.get("values", {})}
    metrics = [name for name in run.settings.metrics if name not in t.CONTRAST_MEASURES]
    names = [*metrics, *(name for name in t.TRUTH_MEASURES if name in found), *t.CONTRAST_MEASURES, "seconds", "wall_seconds",
             "host", "error"]
    lines = [["scene", "method", *names]]
    for scene, of in run.results.items():
        for method in run.methods:
            known = {**of[method], **of[method].get("values", {}), **of[method].get("contrast", {})}
            lines.append([scene, method, *map(known.get, names)])
    return _csv(lines)


def scores_csv(tables):
    """T4: by the metrics, and by the truth where it is known."""
    found = {by: t.standings(row.scores for row in getattr(tables, by)) for by in ("metrics", "truth")}
    columns = t.score_columns([it for of in found.values() for it in of.values()], len(tables.methods))
    lines = [["by", "method", *map(t.score, columns), "total", "rank"]]
    lines += [[by, name, *(it.times[value] for value in columns), it.total, it.rank]
              for by, of in found.items() for name, it in of.items()]
    return _csv(lines)


def as_json(run, tables):
    """Infinity and NaN, which JSON has not, are null."""
    results = {scene: {method: {key: value for key, value in result.items() if key != "fingerprint"}
                       for method, result in of.items()} for scene, of in run.results.items()}
    scores = {by: {"rows": [{"scene": row.scene, "measure": row.measure, "scores": row.scores} for row in rows],
                   "standings": {name: {"times": {t.score(score): times for score, times in sorted(it.times.items())},
                                        "total": it.total, "rank": it.rank}
                                 for name, it in t.standings(row.scores for row in rows).items()}}
              for by, rows in (("metrics", tables.metrics), ("contrast", tables.contrast), ("truth", tables.truth))}
    content = {"version": VERSION, "scenes": {scene.name: str(scene.path) for scene in run.scenes}, "methods": run.methods,
               "metrics": run.settings.metrics, "results": results, "scores": scores, "timing": run.timing_note,
               "failures": run.failures, "versions": run.versions}
    finite = json.loads(json.dumps(content), parse_constant=lambda _: None)
    return json.dumps(finite, indent=2, allow_nan=False) + "\n"
