#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run bench_steps and print tables of times and allocations as Markdown."""
import json
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from all_in_focus import installed
from all_in_focus.command_line import Parser, count, run as run_program
from all_in_focus.progress import Progress
from all_in_focus_lab.benchmark.tables import markdown

ROOT = Path(__file__).absolute().parent.parent
BENCH_STEPS = str(ROOT / "build/devel/lib/all_in_focus/bench_steps")
FUSE_STACK = str(ROOT / "build/.install/lib/all_in_focus/fuse_stack")
TIMEOUT_S = 3 * 3600
SIZES = ((640, 480), (4416, 1242))

TITLES = {
    "copyFrame": "plain copy of one colour frame",
    "registerAndFill/paper": "registration, dilation, filling; paper",
    "registerAndFill/refined": "registration by footprints, filling; refined",
    "segment/paper_kinect": "segmentation, steps of a Kinect; paper",
    "segment/refined_kinect": "segmentation, steps of a Kinect; refined",
    "segment/paper_noisy": "segmentation, 3 mm noise on every pixel; paper",
    "segment/refined_noisy": "segmentation, 3 mm noise on every pixel; refined",
    "fuse/paper": "fusion of one frame; paper",
    "fuse/refined_without_alignment": "fusion of one frame, not aligned; refined",
    "fuse/refined_aligned": "fusion of one frame, aligned and warped; refined",
    "runWithTwoFrames/paper": "everything, two frames; paper",
    "runWithTwoFrames/refined": "everything, two frames; refined",
}
NAME = re.compile(r"(?P<step>.+?)/width:(?P<width>\d+)/height:(?P<height>\d+)/threads:(?P<threads>\d+)")
COUNTERS = ("copies", "allocations", "allocated_bytes", "touched_bytes")

# In a small process of its own: the kernel counts the memory of the one that starts a program as the program's, too.
MEASURE = """import os, resource, sys, time
begin = time.monotonic()
status = os.spawnvp(os.P_WAIT, sys.argv[1], sys.argv[1:])
seconds, usage = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
sys.stderr.write(f"\\n{seconds} {usage.ru_utime + usage.ru_stime} {usage.ru_maxrss}\\n")
sys.exit(status)"""


def run_measured(command):
    """Seconds, CPU seconds and peak memory in MB of a program. RuntimeError with its last line where it fails."""
    result = subprocess.run([sys.executable, "-S", "-c", MEASURE, *command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                            universal_newlines=True, errors="replace")
    *said, measured = filter(None, result.stderr.splitlines())
    if result.returncode:
        raise RuntimeError(said[-1] if said else f"{command[0]} fails")
    seconds, cpu_seconds, peak_kb = map(float, measured.split())
    return seconds, cpu_seconds, peak_kb / 1024


def in_turn(commands, repetitions):
    """Medians of what run_measured() returns, by name; commands: by name."""
    runs = {name: [] for name in commands}
    for name in Progress([name for _ in range(repetitions) for name in commands], unit="run"):
        runs[name].append(run_measured(commands[name]))
    return {name: np.median(values, axis=0) for name, values in runs.items()}


def run(program, only, repetitions, sample):
    """(step, width, height, threads) -> its medians over the repetitions, ms and COUNTERS.

    only: regular expression of names; sample: rig folder and depth map. Raises RuntimeError, OSError.
    """
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder, "steps.json")
        # Repetitions in turn, so that whatever else the machine does meets all alike.
        command = [program, "--benchmark_filter=" + only, f"--benchmark_repetitions={repetitions}",
                   "--benchmark_enable_random_interleaving=true", "--benchmark_min_time=0.1",
                   f"--benchmark_out={output}", "--benchmark_out_format=json", *sample]
        installed.run(command, TIMEOUT_S)
        return read(json.loads(output.read_text(encoding="utf-8")))


def read(data):
    """The same from what --benchmark_out holds."""
    runs = {}
    for entry in data["benchmarks"]:
        if entry["run_type"] == "iteration":
            name = NAME.match(entry["name"])
            key = (name["step"], int(name["width"]), int(name["height"]), int(name["threads"]))
            runs.setdefault(key, []).append(dict({c: entry[c] for c in COUNTERS}, ms=entry["real_time"]))
    return {key: {name: statistics.median(entry[name] for entry in entries) for name in entries[0]}
            for key, entries in runs.items()}


def number(value):
    """Two digits, as text."""
    return np.format_float_positional(value, 2, unique=False, fractional=False, trim="-")


def times_table(figures, sizes):
    """Markdown: ms with one thread and with two, and copies, of each step at each of the sizes."""
    head = ["step"]
    for width, height in sizes:
        head += [f"{width}x{height}, ms", "2 threads", "copies"]

    def row(step):
        for width, height in sizes:
            one, two = (figures.get((step, width, height, threads)) for threads in (1, 2))
            yield from (number(one["ms"]), number(two["ms"]), number(one["copies"])) if one and two else ("-",) * 3

    return table(head, figures, row)


def allocations_table(figures, width, height):
    """Markdown: allocations of each step, with one thread and with two."""
    def row(step):
        for threads in (1, 2):
            entry = figures.get((step, width, height, threads))
            yield from (number(round(entry["allocations"], 1)), size(entry["allocated_bytes"])) if entry else ("-",) * 2

    return table([f"step at {width}x{height}", "allocations", "bytes", "2 threads", "bytes"], figures, row)


def table(head, figures, row):
    """row(step): cells of a step that has been measured."""
    return markdown([head, *([TITLES[step], *row(step)] for step in TITLES if any(key[0] == step for key in figures))], left=1)


def size(number_of_bytes):
    """In B, kB or MB."""
    for unit in ("B", "kB"):
        if number_of_bytes < 1000:
            return f"{round(number_of_bytes)} {unit}"
        number_of_bytes /= 1000
    return f"{number(number_of_bytes)} MB"


def main():
    parser = Parser(prog="steps.py", description=__doc__)
    parser.add_argument("--rig", required=True, help="rig folder, whose colour camera has 640x480 pixels")
    parser.add_argument("--depth", required=True, help="depth image of its depth camera, 16-bit PNG, mm")
    parser.add_argument("--repetitions", type=count, default=5, metavar="N", help="default %(default)s")
    parser.add_argument("--bench-steps", default=BENCH_STEPS, metavar="PATH")
    args = parser.parse_args()
    figures = run(args.bench_steps, f"width:({'|'.join(str(width) for width, _ in SIZES)})/", args.repetitions,
                  (args.rig, args.depth))
    print(times_table(figures, SIZES) + "\n" + allocations_table(figures, *SIZES[0]))


if __name__ == "__main__":
    run_program(main, RuntimeError)
