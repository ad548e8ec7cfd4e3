# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The benchmark programs: wrong arguments give one line; tables come out of what bench_steps writes."""
import sys
from pathlib import Path

import pytest
from file_helpers import call
from tool_helpers import expect_refusal

BENCH = Path(__file__).resolve().parent.parent / "bench"
sys.path.insert(0, str(BENCH))
import steps  # noqa: E402


@pytest.mark.parametrize("line", [
    "fusion.py --frames 0", "fusion.py --peer cp", "graph_rate", "graph_rate --rig /none --depth x",
    "graph_rate --rig x --depth x --size huge", "graph_source.py --rig x", "steps.py --rig x",
    "steps.py --rig x --depth x --bench-steps /none"])
def test_wrong_arguments_give_one_line(line, tmp_path, monkeypatch):
    program, *arguments = line.split()
    monkeypatch.chdir(tmp_path)
    expect_refusal(call(BENCH / program, *arguments), program)
    assert not list(tmp_path.iterdir())


def entry(ms, threads, run_type="iteration"):
    return {"name": f"fuse/paper/width:640/height:480/threads:{threads}/manual_time", "run_type": run_type,
            "real_time": ms, "copies": 10 * ms, "allocations": 0, "allocated_bytes": 1500, "touched_bytes": 1}


def test_tables_hold_medians_of_repetitions():
    runs = [entry(ms, 1) for ms in (1, 3, 200)] + [entry(1.5, 2), entry(99, 1, "aggregate")]
    figures = steps.read({"benchmarks": runs})
    assert figures[("fuse/paper", 640, 480, 1)]["ms"] == 3
    lines = steps.times_table(figures, [(640, 480), (320, 240)]).splitlines()
    assert lines[0].count("|") == 8 and lines[2] == "| fusion of one frame; paper | 3 | 1.5 | 30 | - | - | - |"
    assert steps.allocations_table(figures, 640, 480).splitlines()[2].endswith("| 0 | 2 kB | 0 | 2 kB |")


@pytest.mark.parametrize("value, text", [(0, "0"), (0.0254, "0.025"), (9.96, "10"), (12.34, "12"), (123.4, "120"), (99.7, "100")])
def test_numbers_have_two_digits(value, text):
    assert steps.number(value) == text
