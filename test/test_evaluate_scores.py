# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scores and ranks against the paper's own tables, and tables T3 and T4 on the two of its scenes that are published."""
import json
import math

import pytest
from evaluate_helpers import evaluate, results, rows
from test_recorded_sample import PAIRS, needs_pairs

from all_in_focus_lab.benchmark.tables import scores, standings
from all_in_focus_lab.metrics import METRICS

METHODS = ("DWT", "NSCT", "IM", "GF", "NSCT-PCNN", "DSIFT", "DCNN", "Ours")

# Table T3: five scenes, each Q_MI, Q_NCIE, Q_G, Q_P, Q_Y, Q_CB.
T3 = [[float(value) for value in line.split()] for line in """\
1.1478 1.0451 1.3869 1.3402 1.3372 1.4235 1.3903 1.4201
0.8463 0.8408 0.8629 0.8597 0.8646 0.8681 0.8635 0.8653
0.6694 0.4408 0.6998 0.6946 0.6421 0.7079 0.7094 0.7153
0.8344 0.7255 0.9129 0.9023 0.8516 0.9049 0.9112 0.9099
0.8992 0.7262 0.9548 0.9412 0.9275 0.9710 0.9721 0.9766
0.7372 0.6935 0.7688 0.7634 0.7977 0.7575 0.7708 0.7742
0.9504 0.8125 1.2323 1.1674 1.0457 1.2308 1.2250 1.2504
0.8308 0.8250 0.8480 0.8426 0.8374 0.8468 0.8465 0.8489
0.6387 0.3889 0.6855 0.6747 0.5777 0.6834 0.6879 0.6954
0.8273 0.6922 0.9159 0.9175 0.8269 0.9141 0.9206 0.9191
0.9012 0.6908 0.9655 0.9431 0.8976 0.9627 0.9716 0.9832
0.7231 0.6681 0.7856 0.7627 0.7744 0.7832 0.7887 0.7977
0.9101 0.8422 1.1820 1.1500 1.0052 1.2015 1.1927 1.2089
0.8284 0.8255 0.8437 0.8414 0.8344 0.8448 0.8442 0.8454
0.6608 0.4649 0.7039 0.6998 0.5672 0.7079 0.7099 0.7143
0.8266 0.7660 0.9070 0.9115 0.8053 0.9112 0.9127 0.9033
0.9151 0.7796 0.9742 0.9602 0.8834 0.9759 0.9799 0.9825
0.7059 0.6699 0.7816 0.7681 0.7169 0.7903 0.7949 0.7954
0.8384 0.7653 1.1384 1.0978 0.9426 1.1727 1.1520 1.1828
0.8249 0.8220 0.8408 0.8382 0.8310 0.8430 0.8415 0.8439
0.6269 0.4355 0.6738 0.6642 0.5434 0.6786 0.6822 0.6886
0.7967 0.7586 0.8972 0.9039 0.7443 0.9020 0.9048 0.9067
0.9047 0.7491 0.9692 0.9500 0.8729 0.9777 0.9837 0.9890
0.6908 0.6486 0.7713 0.7527 0.7075 0.7828 0.7852 0.7834
0.9352 0.8659 1.1746 1.1420 0.9868 1.2248 1.1968 1.2311
0.8305 0.8276 0.8444 0.8435 0.8335 0.8481 0.8465 0.8482
0.6432 0.4472 0.6720 0.6594 0.5506 0.6751 0.6753 0.6885
0.8381 0.7649 0.9011 0.8953 0.7858 0.8973 0.8984 0.9214
0.9016 0.7483 0.9628 0.9419 0.8702 0.9698 0.9769 0.9802
0.7117 0.6785 0.7860 0.7607 0.7186 0.7966 0.7964 0.8014""".split("\n")]

# Table T4: times of the scores 8 to 1, total, rank.
T4 = {"Ours": ([23, 5, 1, 0, 1, 0, 0, 0], 229, 1), "DCNN": ([3, 14, 10, 3, 0, 0, 0, 0], 197, 2),
      "DSIFT": ([2, 7, 13, 6, 1, 1, 0, 0], 180, 3), "IM": ([1, 3, 3, 21, 2, 0, 0, 0], 160, 4),
      "GF": ([0, 1, 2, 0, 25, 2, 0, 0], 125, 5), "NSCT-PCNN": ([1, 0, 1, 0, 1, 14, 12, 1], 85, 6),
      "DWT": ([0, 0, 0, 0, 0, 0, 13, 17], 73, 7), "NSCT": ([0, 0, 0, 0, 0, 0, 1, 29], 31, 8)}


def test_the_papers_table_of_scores():
    found = standings(scores(dict(zip(METHODS, line))) for line in T3)
    for name, (times, total, rank) in T4.items():
        if name != "DWT":
            assert [found[name].times[score] for score in range(8, 0, -1)] == times, name
        assert (found[name].total, found[name].rank) == (total, rank)
    # The paper's row of DWT is set one column too far right: 13 * 2 + 17 * 1 are not the 73 that it gives.
    assert [found["DWT"].times[score] for score in (3, 2)] == [13, 17]


def test_equal_values_share_the_mean_score():
    assert scores({"a": 1.0, "b": 2.0, "c": 1.0, "d": 0.5}) == {"a": 2.5, "b": 4.0, "c": 2.5, "d": 1.0}


def test_what_failed_has_no_score_and_costs_the_others_none():
    assert scores({"a": None, "b": 2.0, "c": math.nan, "d": math.inf}) == {"a": None, "b": 3.0, "c": None, "d": 4.0}
    assert scores({"a": None}) == {"a": None}


def test_equal_totals_share_the_mean_rank():
    found = standings([{"a": 3.0, "b": 2.0, "c": 1.0}, {"a": 2.0, "b": 3.0, "c": None}])
    assert [(name, it.total, it.rank) for name, it in found.items()] == [("a", 5, 1.5), ("b", 5, 1.5), ("c", 1, 3)]
    assert found["c"].times == {1.0: 1}
    assert standings([]) == {}


@pytest.mark.parametrize("count", [1, 2, 9])
def test_ranks_are_1_to_n(count):
    found = standings([{str(n): float(n + 1) for n in range(count)}])
    assert sorted(it.rank for it in found.values()) == list(range(1, count + 1))


# --- recorded scenes: see test_recorded_sample ------------------------------------------------------------------------

# Column of the table -> entry of metrics.json, and the method of evaluate that gives this image.
RECOMPOSED = "recovered_label_recomposed"
PUBLISHED = {"DWT": "dwt", "NSCT": "nsct", "IM": "im", "GF": "gf_diff", "NSCT-PCNN": "pcnn", "DSIFT": "dsift", "Ours": RECOMPOSED}
EVALUATED = {column: "paper" if entry == RECOMPOSED else f"given:{entry}" for column, entry in PUBLISHED.items()}
TOLERANCE = 6e-4  # our label map was recovered from a picture; Q_Y as printed cannot be met closer


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pairs")
    code, out, err = evaluate(PAIRS, "--methods", ",".join(EVALUATED.values()), "--output", folder)
    assert (code, err) == (0, "")
    print(out)
    return folder


@needs_pairs
def test_values_of_the_paper(output):
    found = results(output)["results"]
    for number, scene in enumerate(("scene1", "scene2")):
        exact = json.loads((PAIRS / scene / "metrics.json").read_text())
        for column, entry in PUBLISHED.items():
            values = found[scene][EVALUATED[column]]["values"]
            assert values == pytest.approx(exact[entry], rel=0, abs=1e-9)
            for row, metric in enumerate(METRICS, 6 * number):
                assert abs(values[metric] - T3[row][METHODS.index(column)]) < TOLERANCE, (scene, column)


@needs_pairs
def test_ranks_of_the_paper(output):
    """Of the seven methods; the paper's order of the lower ones rests on all five scenes."""
    ranked = [row["method"] for row in rows(output, "scores.csv") if row["by"] == "metrics"]
    assert ranked[0] == "paper" and set(ranked[1:3]) == {"given:dsift", "given:im"}
    assert ranked[3:] == ["given:gf_diff", "given:pcnn", "given:dwt", "given:nsct"]
