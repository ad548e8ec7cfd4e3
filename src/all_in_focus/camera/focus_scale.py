# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What distance the lens is focused on at a step of its drive."""
import math

import numpy as np

SMALL = 1e-9


class ScaleError(ValueError):
    """A table that cannot be right; the message is one line."""


class FocusScale:
    """Table of steps and focus distances (mm, .inf allowed), measured at a few steps.

    Between them the dioptres are interpolated: a lens that moves by equal steps changes its dioptres by equal amounts,
    nearly. Beyond the table nothing is known: NaN.
    """

    def __init__(self, table):
        """table: [{step: 0, mm: 500}, {step: 12, mm: .inf}, ...], at least two, distances growing with the steps or
        falling all the way."""
        try:
            rows = sorted((int(row["step"]), float(row["mm"])) for row in table)
        except (KeyError, TypeError, ValueError):
            raise ScaleError("focus_table: expected [{step: 0, mm: 500}, {step: 12, mm: .inf}, ...]")
        if len(rows) < 2 or not all(mm > 0 for _, mm in rows):
            raise ScaleError("focus_table: expected two steps or more with positive distances")
        self._steps = np.array([step for step, _ in rows])
        self._dioptres = np.array([1000 / mm for _, mm in rows])  # 1 / m
        rises = np.diff(self._dioptres)
        if not ((rises > 0).all() or (rises < 0).all()) or not (np.diff(self._steps) > 0).all():
            raise ScaleError("focus_table: steps must differ, and the distances must grow or fall all the way")

    def distance(self, step):
        """Focus distance in m at a step."""
        if not self._steps[0] <= step <= self._steps[-1]:
            return math.nan
        dioptre = float(np.interp(step, self._steps, self._dioptres))
        return 1 / dioptre if dioptre > SMALL else math.inf

    def step(self, distance):
        """The whole step nearest in dioptres to a distance in m; beyond the table its end."""
        order = np.argsort(self._dioptres)
        return int(round(float(np.interp(1 / distance, self._dioptres[order], self._steps[order]))))

    def reaches(self, distance):
        """Whether a distance in m lies within the table."""
        return self._dioptres.min() - SMALL <= 1 / distance <= self._dioptres.max() + SMALL
