#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time programs on a focus bracket of large JPEGs, as a photographer has it, in turn, as a Markdown table of medians.

Pictures are generated: texture of several sizes, sharp in another band of each, and magnified a little more from one to
the next. fuse_stack runs in mode refined without depth; enfuse beside it, if installed, and whatever --peer adds, such as
another build of fuse_stack. Peak memory is that of the program alone.
"""
import argparse
import shlex
import shutil
import tempfile
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

import steps
from all_in_focus.command_line import Parser, count

ASPECT = 1.5
QUALITY = 92  # of the JPEGs


def parse_arguments():
    parser = Parser(prog="photos.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=count, default=12, metavar="N", help="default %(default)s")
    parser.add_argument("--megapixels", type=float, default=20, metavar="MP", help="default %(default)s")
    parser.add_argument("--repetitions", type=count, default=3, metavar="N", help="default %(default)s")
    parser.add_argument("--peer", action="append", default=[], metavar="NAME=COMMAND",
                        help="one more program; in COMMAND {stack} {files} {output} are replaced")
    parser.add_argument("--fuse-stack", default=steps.FUSE_STACK, metavar="PATH", help="default: that of scripts/build")
    args = parser.parse_args()
    if any("=" not in peer for peer in args.peer):
        parser.error("--peer: expected NAME=COMMAND")
    return args


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
    return width, height


def main():
    args = parse_arguments()
    with tempfile.TemporaryDirectory() as folder:
        stack, output = Path(folder) / "stack", Path(folder) / "fused.jpg"
        stack.mkdir()
        width, height = make_pictures(stack, args.frames, args.megapixels)
        files = " ".join(shlex.quote(str(path)) for path in sorted(stack.iterdir()))
        commands = {"fuse_stack (refined)": f"{shlex.quote(str(args.fuse_stack))} --stack {{stack}} --output {{output}}"}
        if shutil.which("enfuse"):
            commands["enfuse"] = "enfuse --exposure-weight=0 --saturation-weight=0 --contrast-weight=1 --hard-mask " \
                                 "--output={output} {files}"
        commands.update(peer.split("=", 1) for peer in args.peer)
        runs = {name: [] for name in commands}
        for name in tqdm([name for _ in range(args.repetitions) for name in commands], disable=None):
            command = shlex.split(commands[name].format(stack=stack, files=files, output=output))
            runs[name].append(steps.run_measured(command)[1:])
    medians = {name: np.median(values, axis=0) for name, values in runs.items()}
    ours = next(iter(medians.values()))[0]
    runs_told = "one run" if args.repetitions == 1 else f"medians of {args.repetitions} runs"
    print(f"{args.frames} JPEGs of {width}x{height}, {runs_told}, in turn.\n")
    print(steps.table(["program", "s", "times ours", "CPU, s", "peak, MB"],
                      [[name, f"{seconds:.2f}", f"{seconds / ours:.2f}", f"{cpu:.2f}", f"{peak:.0f}"]
                       for name, (seconds, cpu, peak) in medians.items()], left=1))


if __name__ == "__main__":
    main()
