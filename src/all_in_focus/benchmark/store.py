# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Results on disk, OUTPUT/results/SCENE/METHOD/: each is there as a whole or not at all, so that a run can go on where
an earlier one was interrupted."""
import json
from pathlib import Path

from all_in_focus.files.output_folder import remove_folder, whole_folder

RESULT = "result.json"  # written last; Python's JSON, which has NaN and Infinity


class Store:
    """The results folder of one output folder."""

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

        Of a failure nothing is kept: the next run tries again.
        """
        target = self.path(scene, method)
        plain = {key: value for key, value in result.items() if key != "files"}
        plain.update(fingerprint=fingerprint, run=run)
        if "error" in result:
            remove_folder(target, "evaluate")
            return plain
        with whole_folder(target, "evaluate", parents=True) as working:
            for name, data in result.get("files", {}).items():
                (working / f"{name}.png").write_bytes(data)
            (working / RESULT).write_text(json.dumps(plain, indent=2), encoding="utf-8")
        return plain

    def picture(self, scene, method, name):
        """Path of a picture of a result, None if it has none."""
        path = self.path(scene, method, f"{name}.png")
        return path if path.exists() else None
