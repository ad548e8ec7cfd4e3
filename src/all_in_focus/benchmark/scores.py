# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scores as in table T3 of the paper and their sums as in T4."""
import math
from collections import Counter
from dataclasses import dataclass

from scipy.stats import rankdata


def scores(values):
    """Name of a method -> score 1..N for N methods, the best has N; of equal values each has the mean of their scores.

    values: name -> number, greater is better; None or NaN where there is none: no score then, and the others have
    theirs as if it were the worst.
    """
    there = {name: value for name, value in values.items() if value is not None and not math.isnan(value)}
    missing = len(values) - len(there)
    ranked = dict(zip(there, rankdata(list(there.values())) + missing)) if there else {}
    return {name: float(ranked[name]) if name in ranked else None for name in values}


@dataclass
class Standing:
    """How often a method had each score, the sum of its scores, its rank (1 = best; the mean of equal ranks)."""
    times: Counter
    total: float
    rank: float


def standings(rows):
    """Name -> Standing. rows: what scores() gave, one for each scene and metric, all of the same methods."""
    rows = list(rows)
    names = list(rows[0]) if rows else []
    times = {name: Counter(row[name] for row in rows if row[name] is not None) for name in names}
    totals = {name: math.fsum(score * count for score, count in times[name].items()) for name in names}
    ranks = dict(zip(names, rankdata([-totals[name] for name in names]))) if names else {}
    return {name: Standing(times[name], totals[name], float(ranks[name])) for name in names}
