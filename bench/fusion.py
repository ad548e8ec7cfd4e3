#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time programs that fuse a bracket from files to file, in turn, and print medians as a Markdown table.

The bracket is a number of large JPEGs that are generated: texture of several sizes, sharp in another band of each, and
magnified a little more from one to the next. enfuse runs beside fuse_stack, if installed, and whatever
--peer adds, such as another build of fuse_stack. Peak memory is that of the program alone.
"""
import argparse
import shlex
import shutil
import tempfile
from pathlib import Path

import cv2
import numpy as np

import steps
from all_in_focus.command_line import Parser, count, run
from all_in_focus_lab.baselines import enfuse
from all_in_focus_lab.benchmark.methods import peer_command
from all_in_focus_lab.benchmark.tables import markdown

ASPECT = 1.5
QUALITY = 92  # of the JPEGs


def parse_arguments():
    parser = Parser(prog="fusion.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=count, default=12, metavar="N", help="default %(default)s")
    parser.add_argument("--megapixels", type=float, default=20, metavar="MP", help="of a JPEG, default %(default)s")
    parser.add_argument("--repetitions", type=count, default=3, metavar="N", help="default %(default)s")
    parser.add_argument("--peer", type=peer_command, action="append", default=[], metavar="NAME=COMMAND",
                        help="one more program; in COMMAND {stack} {files} {output} are replaced")
    parser.add_argument("--fuse-stack", default=steps.FUSE_STACK, metavar="PATH", help="default: that of scripts/build")
    return parser.parse_args()


def make_pictures(folder, frames, megapixels):
    width = int((megapixels * 1e6 * ASPECT) ** 0.5) // 32 * 32
    height = int(width / ASPECT) // 32 * 32
    random = np.random.default_rng(1)
    sharp = cv2.GaussianBlur(random.integers(0, 256, (height, width, 3), dtype=np.uint8), (0, 0), 0.8)
    for cell in (4, 32):
        coarse = random.integers(0, 256, (height // cell, width // cell, 3), dtype=np.uint8)
        sharp = cv2.addWeighted(sharp, 0.5, cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), 0.5, 0)
    blurred = cv2.GaussianBlur(sharp, (0, 0), 4)
    for index in range(frames):
        frame = blurred.copy()
        band = slice(index * width // frames, (index + 1) * width // frames)
        frame[:, band] = sharp[:, band]
        magnified = cv2.getRotationMatrix2D((width / 2, height / 2), 0, 1 + 0.0015 * index)
        frame = cv2.warpAffine(frame, magnified, (width, height), borderMode=cv2.BORDER_REFLECT)
        cv2.imwrite(str(folder / f"{index:02d}.jpg"), frame, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


def commands(args):
    """Name of a program -> its command line."""
    programs = {"fuse_stack (refined)": f"{shlex.quote(str(args.fuse_stack))} --stack {{stack}} --output {{output}}"}
    if shutil.which("enfuse"):
        programs["enfuse"] = f"enfuse {' '.join(enfuse.OPTIONS)} --output={{output}} {{files}}"
    return {**programs, **dict(args.peer)}


def main():
    args = parse_arguments()
    with tempfile.TemporaryDirectory() as folder:
        stack = Path(folder) / "stack"
        stack.mkdir()
        make_pictures(stack, args.frames, args.megapixels)
        files = sorted(stack.iterdir())
        known = {"stack": stack, "files": " ".join(shlex.quote(str(file)) for file in files),
                 "output": Path(folder) / "fused.png"}
        filled = {name: shlex.split(command.format(**known)) for name, command in commands(args).items()}
        height, width = cv2.imread(str(files[0])).shape[:2]
        medians = steps.in_turn(filled, args.repetitions)
    ours = next(iter(medians.values()))[0]
    runs_told = "one run" if args.repetitions == 1 else f"medians of {args.repetitions} runs"
    print(f"{len(files)} pictures of {width}x{height}, {runs_told}, in turn.\n")
    print(markdown([["program", "s", "times ours", "CPU, s", "peak, MB"],
                    *([name, f"{seconds:.2f}", f"{seconds / ours:.2f}", f"{cpu:.2f}", f"{peak:.0f}"]
                      for name, (seconds, cpu, peak) in medians.items())], left=1))


if __name__ == "__main__":
    run(main, KeyError, RuntimeError, cv2.error)
