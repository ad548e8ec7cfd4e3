# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Focus tables: the focus distance of each lens position, as calibrate_focus writes them."""
import math

import numpy as np

from all_in_focus.files import yaml_file

SMALL = 1e-9  # 1/m; below this a focus distance counts as infinite


class FocusTable:
    """Focus distance at each step, from a table of steps and distances (mm, .inf allowed) measured at a few steps, and how a
    bracket was shot: frame i is at step `first` + i * `step`; by default i is the step itself.

    Between the entries the inverse distance (dioptres) is interpolated: equal steps of a lens change it by nearly equal
    amounts. Beyond the table the distance is unknown, NaN.
    """

    def __init__(self, table, first=0, step=1, where=""):
        """table: [{step: 0, mm: 500}, {step: 12, mm: .inf}, ...], two entries or more; the distances must grow with the
        steps throughout, or fall throughout. Raises ValueError, which begins with `where`."""
        self.table, self.first, self.step = table, first, step
        for number, row in enumerate(table if isinstance(table, list) else ()):
            yaml_file.require_keys(row, ("step", "mm"), f"{where}focus_table: entry {number}")
        try:
            rows = sorted((row["step"], float(row["mm"])) for row in table)
            if not all(type(step) is int for step, _ in rows):
                raise ValueError
        except (KeyError, TypeError, ValueError):
            raise ValueError(f"{where}focus_table: expected [{{step: 0, mm: 500}}, {{step: 12, mm: .inf}}, ...]")
        if len(rows) < 2 or not all(mm > 0 for _, mm in rows):
            raise ValueError(f"{where}focus_table: expected two steps or more with positive distances")
        self._steps = np.array([step for step, _ in rows])
        self._dioptres = np.array([1000 / mm for _, mm in rows])  # 1 / m
        rises = np.diff(self._dioptres)
        if not ((rises > 0).all() or (rises < 0).all()) or not (np.diff(self._steps) > 0).all():
            raise ValueError(f"{where}focus_table: steps must differ, and the distances must grow or fall throughout")

    @classmethod
    def of(cls, data, path):
        """From the content of the YAML file `path`; None where it holds no table. ValueError."""
        if not isinstance(data, dict) or "focus_table" not in data:
            return None
        yaml_file.require_keys(data, ("focus_table", "first", "step", "home"), path)
        first, step = data.get("first", 0), data.get("step", 1)
        for name, value in (("first", first), ("step", step)):
            if type(value) is not int:
                raise ValueError(f"{path}: {name}: expected a whole number, not '{value}'")
        return cls(data["focus_table"], first, step, f"{path}: ")

    def distance(self, index):
        """Focus distance in m of a frame by its index in the bracket."""
        step = self.first + index * self.step
        if not self._steps[0] <= step <= self._steps[-1]:
            return math.nan
        dioptre = float(np.interp(step, self._steps, self._dioptres))
        return 1 / dioptre if dioptre > SMALL else math.inf

    def nearest_step(self, distance):
        """The whole step whose dioptres are nearest to those of a distance in m; beyond the table, its last entry."""
        order = np.argsort(self._dioptres)
        return int(round(float(np.interp(1 / distance, self._dioptres[order], self._steps[order]))))

    def reaches(self, distance):
        """Whether a distance in m lies within the table."""
        return self._dioptres.min() - SMALL <= 1 / distance <= self._dioptres.max() + SMALL

    def save(self, path, comments=(), home=""):
        """home: where step 0 is, for focus_bracket_camera; empty: not told."""
        table = [{"step": row["step"], "mm": round(float(row["mm"]), 1)} for row in self.table]
        data = {"home": home} if home else {}
        data.update({"first": self.first, "step": self.step, "focus_table": table})
        yaml_file.write(path, data, "".join(f"# {line}\n" for line in comments))
