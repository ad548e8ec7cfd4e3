# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tables T3, T4 and T5 of the paper from results, as rows that the terminal, CSV files and the page show alike: scores
as in T3, their sums as in T4."""
import math
from collections import Counter
from dataclasses import dataclass
from statistics import fmean
from typing import Dict, List, NamedTuple, Optional

from scipy.stats import rankdata

from all_in_focus_lab.metrics import CONTRAST_MEASURES, TRUTH_MEASURES

LESS_IS_BETTER = {"roughness", "seconds"}
DEPTHS = {"measured": "as measured", "registered": "holes filled"}  # the same for every method that has them
DIGITS = {"PSNR": 2, "PSNR_edges": 2}  # behind the point; of others 4


def scores(values):
    """Name of a method -> score 1..N for N methods, the best has N; of equal values each has the mean of their scores.

    values: name -> number, greater is better; None or NaN where there is none. Such a method has no score; the
    others have theirs as if it were the worst.
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
    """T4: name -> Standing, best first. rows: what scores() gave, one for each scene and metric, all of the same methods."""
    rows = list(rows)
    names = list(rows[0]) if rows else []
    times = {name: Counter(row[name] for row in rows if row[name] is not None) for name in names}
    totals = {name: math.fsum(score * count for score, count in times[name].items()) for name in names}
    ranks = dict(zip(names, rankdata([-totals[name] for name in names]))) if names else {}
    return {name: Standing(times[name], totals[name], float(ranks[name])) for name in sorted(names, key=ranks.get)}


@dataclass
class Row:
    """One measure on one scene: value and score of each method, None where it failed."""
    scene: str
    measure: str
    values: Dict[str, Optional[float]]
    scores: Dict[str, Optional[float]]

    @classmethod
    def of(cls, scene, measure, values):
        sign = -1 if measure in LESS_IS_BETTER else 1
        signed = {method: value if value is None else sign * value for method, value in values.items()}
        return cls(scene, measure, values, scores(signed))


@dataclass
class Tables:
    """methods, in order; metrics, contrast and truth: rows of T3 by the metrics of the paper, by the contrast that is
    kept, and by the truth; seconds: rows of T5; depths: scene -> depth map -> (share wrong, RMSE)."""
    methods: List[str]
    metrics: List[Row]
    contrast: List[Row]
    truth: List[Row]
    seconds: List[Row]
    depths: Dict[str, Dict[str, tuple]]


def build(results, methods, metric_names):
    """Tables of results: scene -> method -> what Store has, {"error": ...} where it failed."""
    def rows(names, kind="values"):
        found = [Row.of(scene, name, {method: of[method].get(kind, {}).get(name) for method in methods})
                 for scene, of in results.items() for name in names]
        return [row for row in found if set(row.values.values()) != {None}]

    seconds = [Row.of(scene, "seconds", {method: of[method].get("seconds") for method in methods})
               for scene, of in results.items()]
    depths = {scene: {DEPTHS.get(name, method): errors for method in methods
                      for name, errors in of[method].get("depths", {}).items()} for scene, of in results.items()}
    return Tables(methods, rows(metric_names), rows(CONTRAST_MEASURES, "contrast"), rows(TRUTH_MEASURES), seconds,
                  {scene: of for scene, of in depths.items() if of})


def number(measure, value):
    """A value, rounded for display."""
    return "-" if value is None else f"{value:.{DIGITS.get(measure, 4)}f}"


def score(value):
    """A score or a rank, with decimals only where it has any."""
    return "-" if value is None else f"{round(value, 2):g}"


def score_columns(found, count):
    """Scores that head the columns of T4, best first: all whole ones, and means of ties that occurred.

    found: Standings; count: of the methods.
    """
    return sorted({float(value) for value in range(1, count + 1)} | {value for it in found for value in it.times},
                  reverse=True)


class Cell(NamedTuple):
    """Cell of a table: its text, the exact value, whether it is the best of its row, text behind it (the score)."""
    text: str
    value: Optional[float] = None
    best: bool = False
    more: str = ""

    def __str__(self):
        return f"{self.text} ({self.more})" if self.more else self.text


def _marked(row, more=True):
    """Cells of a row; more: whether scores are shown behind the values."""
    best = max((it for it in row.scores.values() if it is not None), default=None)
    return [Cell(number(row.measure, value), value, it is not None and it == best, score(it) if more and it is not None else "")
            for value, it in zip(row.values.values(), row.scores.values())]


def _mean(values):
    """Of those that are there; None without any."""
    there = [value for value in values if value is not None]
    return fmean(there) if there else None


def value_cells(tables, rows):
    """T3: heading, then one line for each row."""
    return [[*map(Cell, ["scene", "measure", *tables.methods])],
            *([Cell(row.scene), Cell(row.measure), *_marked(row)] for row in rows)]


def standing_cells(tables, rows):
    """T4."""
    found = standings(row.scores for row in rows)
    columns = score_columns(found.values(), len(tables.methods))
    lines = [[*map(Cell, ["method", *map(score, columns), "total", "rank"])]]
    for name, it in found.items():
        texts = [*(str(it.times[value]) for value in columns), score(it.total), score(it.rank)]
        lines.append([Cell(name), *(Cell(text, float(text)) for text in texts)])
    return lines


def seconds_cells(tables):
    """T5."""
    mean = Row.of("mean", "seconds", {name: _mean(row.values[name] for row in tables.seconds) for name in tables.methods})
    return [[*map(Cell, ["scene", *tables.methods])],
            *([Cell(row.scene), *_marked(row, more=False)] for row in [*tables.seconds, mean])]


def mean_cells(tables, rows):
    """Means over the scenes that have a value, and how many those are, as lists of text: one line for each measure."""
    lines = [["mean (of scenes)"] + tables.methods]
    for measure in dict.fromkeys(row.measure for row in rows):
        of = [row.values for row in rows if row.measure == measure]
        lines.append([measure] + [f"{number(measure, _mean(values[name] for values in of))} "
                                  f"({sum(values[name] is not None for values in of)})" for name in tables.methods])
    return lines


def depth_cells(tables):
    """As lists of text: share of the depth map that is wrong by more than 1 px of blur (holes too), %, and RMSE without
    holes, 1/m, of each depth map that the modes used or found."""
    names = list(dict.fromkeys([*DEPTHS.values(), *(name for of in tables.depths.values() for name in of)]))
    names = [name for name in names if any(name in of for of in tables.depths.values())]

    def cells(of):
        return [f"{100 * of[name][0]:.2f} / {of[name][1]:.3f}" if name in of else "-" for name in names]

    means = {name: [fmean(part) for part in zip(*(of[name] for of in tables.depths.values() if name in of))] for name in names}
    return [["scene"] + names, *([scene] + cells(of) for scene, of in tables.depths.items()), ["mean"] + cells(means)]


def markdown(lines, left=None):
    """Cells, or texts, as a table, padded so that it reads well as it is, too. left: so many columns to the left, the others to
    the right, nothing padded: for a page."""
    lines = [[str(cell) for cell in line] for line in lines]
    widths = [max(len(line[column]) for line in lines) if left is None else 1 for column in range(len(lines[0]))]
    text = [f"| {' | '.join(cell.ljust(width) for cell, width in zip(line, widths))} |" for line in lines]
    ruled = [f"{'-' * (width + 2)}{':' if left is not None and column >= left else ''}" for column, width in enumerate(widths)]
    text.insert(1, f"|{'|'.join(ruled)}|")
    return "\n".join(text) + "\n"
