#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Draw how time grows with pixels, and time and memory with the number of frames, beside what linear would be.

Takes the minimum of several runs, because other programs can only make a run slower. Depth is generated, with 3 mm of noise
on every pixel but for the segmentation of a Kinect's depth. A bracket of many frames repeats the frames of a sweep of 30.
Needs a sourced setup.bash and bench_steps (see docs/lab/performance.md).
"""
import argparse
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import steps
from all_in_focus.command_line import Input, Output, Parser, count, run
from all_in_focus.files.stack import focus_entries, save_focus
from all_in_focus.installed import find
from all_in_focus.progress import Progress

FRAMES = (2, 5, 15, 50, 150, 540)
SWEEP = 30  # different frames
MODES = ("paper", "refined")


def parse_arguments():
    parser = Parser(prog="growth.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Output, required=True, metavar="PNG")
    parser.add_argument("--json", type=Output, metavar="FILE", help="write the figures there")
    parser.add_argument("--take", type=Input, metavar="FILE", help="draw these figures, as --json wrote them; measure nothing")
    parser.add_argument("--repetitions", type=count, default=3, metavar="N", help="of each run, default %(default)s")
    parser.add_argument("--bench-steps", default=steps.BENCH_STEPS, metavar="PATH")
    parser.add_argument("--fuse-stack", default=steps.FUSE_STACK, metavar="PATH", help="default: that of scripts/build")
    return parser.parse_args()


def make_stack(scene, frames, folder):
    """Folder of links to the frames of the scene's sweep, and the focus distances of them."""
    sweep = focus_entries(scene / "focus.yaml")
    taken = [sweep[i * len(sweep) // frames] for i in range(frames)]
    names = [f"{i:04d}.png" for i in range(frames)]
    (folder / "stack").mkdir(parents=True)
    for name, (picture, _) in zip(names, taken):
        (folder / "stack" / name).symlink_to(scene / "stack" / picture)
    save_focus(folder / "focus.yaml", names, [1000 * distance for _, distance in taken])


def measure_frames(program, repetitions, scene):
    """mode -> rows of number of frames, ms of fusion, peak memory in MB."""
    runs = {}
    with tempfile.TemporaryDirectory() as temporary:
        scene, folder = Path(scene), Path(temporary)
        subprocess.run([sys.executable, find("make_scene"), "--scene", "planes", "--size", "640x480", "--frames", str(SWEEP),
                        "--output", scene], check=True, stdout=subprocess.DEVNULL)
        for frames in FRAMES:
            make_stack(scene, frames, folder / str(frames))
        todo = [(mode, frames) for _ in range(repetitions) for frames in FRAMES for mode in MODES]
        for mode, frames in Progress(todo, unit="stack"):
            stack = folder / str(frames)
            text, _, _, memory = steps.run_measured([
                program, "--stack", stack / "stack", "--focus", stack / "focus.yaml", "--mode", mode, "--rig", scene / "rig",
                "--depth", scene / "depth.png", "--timings", "--output", folder / "fused.png"])
            fusion_ms = float(re.search(r"fusion ([-+.e\d]+) ms", text)[1])
            runs.setdefault((mode, frames), []).append((fusion_ms, memory))
    return {mode: [[frames, *(min(column) for column in zip(*runs[mode, frames]))] for frames in FRAMES]
            for mode in MODES}


def measure(args):
    figures = steps.run(args.bench_steps, only="threads:1", repetitions=args.repetitions)
    pixels = {}
    for (step, width, height, _), entry in sorted(figures.items(), key=lambda item: item[0][1] * item[0][2]):
        pixels.setdefault(step, []).append([width * height, entry["least_ms"]])
    with tempfile.TemporaryDirectory() as scene:
        return {"pixels": pixels, "frames": measure_frames(args.fuse_stack, args.repetitions, scene)}


def import_pyplot():
    """Without a screen. Not at the top: the package itself does without matplotlib."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot
    return matplotlib.pyplot


def draw(plt, figures, output):
    fig, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 6.2), dpi=75, gridspec_kw={"width_ratios": (1.4, 1, 1)})
    slowest_first = sorted(figures["pixels"].items(), key=lambda item: -item[1][-1][1])
    for color, (step, rows) in zip(plt.get_cmap("tab20").colors, slowest_first):
        x, y = zip(*rows)
        left.loglog(x, y, "o-", color=color, lw=1.5, ms=4, label=steps.TITLES[step])
        left.loglog(x, [y[0] * n / x[0] for n in x], ":", color=color, lw=1)
    left.set(xlabel="pixels", ylabel="ms", title="each step, one thread; dotted: linear")
    for mode, rows in figures["frames"].items():
        frames, ms, memory = zip(*rows)
        line, = middle.loglog(frames, ms, "o-", ms=4, label="mode " + mode)
        middle.loglog(frames, [ms[-1] * n / frames[-1] for n in frames], ":", color=line.get_color(), lw=1)
        right.semilogx(frames, memory, "o-", ms=4, label="mode " + mode)
    middle.set(xlabel="frames of 640x480", ylabel="ms", title="fusion of a bracket; dotted: linear")
    right.set(xlabel="frames of 640x480", ylabel="MB", title="peak memory of fuse_stack")
    right.set_ylim(0, 1.15 * right.get_ylim()[1])
    for axes in (left, middle, right):
        axes.grid(alpha=0.3)
    middle.legend()
    right.legend()
    fig.tight_layout(rect=(0, 0.17, 1, 1))
    fig.legend(*left.get_legend_handles_labels(), loc="lower center", ncol=3, fontsize=9, frameon=False)
    fig.savefig(output)


def main():
    args = parse_arguments()
    plt = import_pyplot()
    figures = json.loads(Path(args.take).read_text(encoding="utf-8")) if args.take else measure(args)
    if args.json:
        Path(args.json).write_text(json.dumps(figures, indent=1), encoding="utf-8")
    Path(args.output).absolute().parent.mkdir(parents=True, exist_ok=True)
    draw(plt, figures, args.output)


if __name__ == "__main__":
    run(main, ImportError, KeyError, RuntimeError, subprocess.SubprocessError)
