#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the sections of docs/lab/performance.md from Steps to Through ROS and print their tables, or write them there.

Takes about 20 minutes.

Needs a sourced setup.bash and bench_steps (see docs/lab/performance.md), and a recorded depth image of a rig whose colour camera
has 640x480 pixels. Parts: steps (times and allocations), photos (large JPEGs), graph (through ROS).
"""
import argparse
import re
import shlex
import subprocess
import sys
from pathlib import Path

import steps
from all_in_focus.command_line import Parser, count, run as run_program

SIZES = ((640, 480), (4416, 1242))
GRAPHS = (  # options of graph_rate
    "--mode paper", "--mode refined", "--mode refined --processes", "--mode refined --size 2208x1242 --rate 15 --frames 150",
    "--mode refined --size 4416x1242 --rate 15 --frames 150 --depth-only --processes",
    "--mode refined --size 4416x1242 --rate 15 --frames 150 --depth-only --processes --noise 3",
    "--mode refined --size 4416x1242 --rate 15 --frames 150 --depth-only --noise 3",
    "--mode refined --size 4416x1242 --rate 10 --frames 100", "--mode refined --size 4416x1242 --rate 15 --frames 150")
PHOTOS = ("--frames 12 --megapixels 20", "--frames 50 --megapixels 6")  # options of fusion.py


def parse_arguments():
    parser = Parser(prog="report.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", required=True, help="rig folder")
    parser.add_argument("--depth", required=True, help="depth image of its depth camera, 16-bit PNG, mm")
    parser.add_argument("--parts", default=",".join(PARTS), metavar="A,B", help="default %(default)s")
    parser.add_argument("--repetitions", type=count, default=5, metavar="N", help="default %(default)s")
    parser.add_argument("--write", metavar="FILE", help="put each part between <!-- PART --> and <!-- /PART --> of that file")
    parser.add_argument("--bench-steps", default=steps.BENCH_STEPS, metavar="PATH")
    args = parser.parse_args()
    args.parts = args.parts.split(",")
    if not set(args.parts) <= set(PARTS):
        parser.error(f"--parts: expected some of {','.join(PARTS)}")
    return args


def run(program, *options):
    """What another program of this folder prints. RuntimeError where it fails."""
    result = subprocess.run([sys.executable, str(Path(__file__).with_name(program)),
                             *map(str, options)], stdout=subprocess.PIPE, universal_newlines=True)
    if result.returncode:
        raise RuntimeError(f"{program} fails")
    return result.stdout.strip()


def measure_steps(args):
    only = f"width:({'|'.join(str(width) for width, _ in SIZES)})/"
    figures = steps.run(args.bench_steps, only, args.repetitions, (args.rig, args.depth))
    return steps.times_table(figures, SIZES) + "\n" + steps.allocations_table(figures, *SIZES[0])


def measure_photos(args):
    return "\n\n".join(run("fusion.py", "--repetitions", min(3, args.repetitions), *shlex.split(options)) for options in PHOTOS)


def measure_graph(args):
    tables = [run("graph_rate", "--rig", args.rig, "--depth", args.depth, *shlex.split(options)) for options in GRAPHS]
    return "\n".join([tables[0], *("\n".join(table.splitlines()[2:]) for table in tables[1:])])


PARTS = {"steps": measure_steps, "photos": measure_photos, "graph": measure_graph}


def write_between_marks(path, part, text):
    path = Path(path)
    after, found = re.subn(f"(<!-- {part} -->\n).*?(<!-- /{part} -->)", lambda m: m[1] + text.strip() + "\n" + m[2],
                           path.read_text(encoding="utf-8"), flags=re.DOTALL)
    if found != 1:
        raise ValueError(f"{path}: has no <!-- {part} --> and <!-- /{part} -->")
    path.write_text(after, encoding="utf-8")


def main():
    args = parse_arguments()
    for part in args.parts:
        text = PARTS[part](args)
        if args.write:
            write_between_marks(args.write, part, text)
        else:
            print(text + "\n", flush=True)


if __name__ == "__main__":
    run_program(main, RuntimeError, subprocess.SubprocessError)
