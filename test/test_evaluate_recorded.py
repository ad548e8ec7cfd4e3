# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tables T3 and T4 of the paper on two of its scenes, as far as they are published; see test_recorded_sample."""
import json

import pytest
from evaluate_helpers import evaluate, results, rows
from test_evaluate_scores import METHODS as PAPER_METHODS
from test_evaluate_scores import T3
from test_recorded_sample import PAIRS, needs_pairs

PUBLISHED = {"DWT": "given:dwt", "NSCT": "given:nsct", "IM": "given:im", "GF": "given:gf_diff", "NSCT-PCNN": "given:pcnn",
             "DSIFT": "given:dsift", "Ours": "paper"}
METRICS = ("Q_MI", "Q_NCIE", "Q_G", "Q_P", "Q_Y", "Q_CB")
TOLERANCE = 6e-4  # our label map was recovered from a picture; Q_Y as printed cannot be met closer


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pairs")
    code, out, err = evaluate(PAIRS, "--methods", ",".join(PUBLISHED.values()), "--output", folder)
    assert (code, err) == (0, "")
    print(out)
    return folder


@needs_pairs
def test_values_of_the_paper(output):
    found = results(output)["results"]
    lines = [line.split() for line in T3.split("\n") if line]
    for number, scene in enumerate(("scene1", "scene2")):
        exact = json.loads((PAIRS / scene / "metrics.json").read_text())
        for method, name in PUBLISHED.items():
            values = found[scene][name]["values"]
            key = "recovered_label_recomposed" if name == "paper" else name[len("given:"):]
            assert values == pytest.approx(exact[key], rel=0, abs=1e-9)
            for row, metric in enumerate(METRICS, 6 * number):
                assert abs(values[metric] - float(lines[row][PAPER_METHODS.index(method)])) < TOLERANCE, (scene, method)


@needs_pairs
def test_ranks_of_the_paper(output):
    """Of its seven methods here; its order of the lower ones rests on all five scenes."""
    ranked = [row["method"] for row in rows(output, "scores.csv") if row["by"] == "metrics"]
    assert ranked[0] == "paper" and set(ranked[1:3]) == {"given:dsift", "given:im"}
    assert ranked[3:] == ["given:gf_diff", "given:pcnn", "given:dwt", "given:nsct"]
