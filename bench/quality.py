#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fuse scenes of known truth by several methods and print how near each comes to it, as Markdown tables.

Needs a sourced setup.bash. Methods: single, oracle, true-depth (bounds that know the truth); dwt, nsct, im, gf, gf-same,
nsct-pcnn, dsift, dcnn, laplacian, enfuse and each with +ecc (frames aligned first); paper and refined (fuse_stack),
refined:-alignment,gain (without these steps), refined:no-depth, refined:optics+20 (focal length 20 % too long),
refined:shift5 (depth 5 pixels to the right).
"""
import argparse
import json
import math
import os
import subprocess
import sys
import time

import cv2
from tqdm import tqdm

import methods
import steps
import suite
from all_in_focus.command_line import Parser
from all_in_focus.metrics.truth import Truth, psnr, ssim
from all_in_focus.files.stack import Stack, read_image

MEASURES = {"psnr": ("PSNR, dB", "%.2f"), "ssim": ("SSIM", "%.4f"),
            "psnr_edges": ("PSNR within 8 px of depth edges, dB", "%.2f"),
            "seconds_per_frame": ("Time per frame, s", "%.3f")}


def peer_of(text):
    """argparse type: NAME=COMMAND."""
    name, equals, command = text.partition("=")
    if not (name and equals and "{output}" in command) or "," in name:
        raise argparse.ArgumentTypeError("'%s': expected NAME=COMMAND with {output} in it" % text)
    return name, command


def suites_of(text):
    """argparse type: A,B of bench/suite.py."""
    names = text.split(",")
    if not set(names) <= set(suite.SUITES):
        raise argparse.ArgumentTypeError(f"'{text}': there are {', '.join(suite.SUITES)}")
    return names


def parse_arguments():
    parser = Parser(prog="quality.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="folders that make_scene wrote")
    parser.add_argument("--generate", metavar="DIR", help="take scenes of bench/suite.py, made in DIR where missing")
    parser.add_argument("--suite", type=suites_of, default=["small"], metavar="A,B",
                        help=f"which of its suites: {', '.join(suite.SUITES)}; default small")
    parser.add_argument("--methods", default="single,oracle,true-depth,gf,gf+ecc,laplacian,laplacian+ecc,paper,refined",
                        metavar="A,B", help="default %(default)s")
    parser.add_argument("--peer", type=peer_of, action="append", default=[], metavar="NAME=COMMAND",
                        help="one more method; in COMMAND {stack} {focus} {rig} {depth} {output} are replaced")
    parser.add_argument("--output", required=True, metavar="DIR", help="for DIR/SCENE/METHOD.png")
    parser.add_argument("--keep", action="store_true", help="take results that are there already")
    parser.add_argument("--time", action="store_true", help="print a table of times too")
    parser.add_argument("--json", metavar="FILE", help="write the figures there")
    parser.add_argument("--fuse-stack", default=steps.FUSE_STACK, metavar="PATH", help="default: that of scripts/build")
    args = parser.parse_args()
    peers = dict(args.peer)
    try:
        args.methods = {name: methods.find(name, args.fuse_stack, peers)
                        for name in methods.split(args.methods) + list(peers)}
    except ValueError as error:
        parser.error(error)
    return parser, args


def measure(method, scene, truth, output, keep):
    """Figures of one method on one scene; None: no depth edges there, or no time, as the result was there already."""
    seconds = None
    if not (keep and os.path.exists(output)):
        if os.path.exists(output):
            os.remove(output)
        begin = time.monotonic()
        method(scene, output)
        seconds = (time.monotonic() - begin) / len(Stack(os.path.join(scene, "stack")))
    image = truth.compared(read_image(output))
    return {"psnr": psnr(image, truth.image), "ssim": ssim(image, truth.image),
            "psnr_edges": psnr(image, truth.image, truth.edges) if truth.edges.any() else None,
            "seconds_per_frame": seconds}


def measure_all(args, scenes):
    """scene name -> method name -> figures, None where a method failed."""
    figures = {}
    with tqdm(total=len(scenes) * len(args.methods), unit="result", disable=not sys.stderr.isatty()) as bar:
        for name, scene in scenes.items():
            os.makedirs(os.path.join(args.output, name), exist_ok=True)
            truth, figures[name] = Truth.load(scene), {}
            for title, method in args.methods.items():
                bar.set_description("%s %s" % (name, title))
                try:
                    output = os.path.join(args.output, name, title + ".png")
                    figures[name][title] = measure(method, scene, truth, output, args.keep)
                except (ValueError, RuntimeError, OSError, cv2.error, subprocess.TimeoutExpired) as error:
                    figures[name][title] = None
                    bar.write("%s %s: %s" % (name, title, " ".join(str(error).split())), file=sys.stderr)
                bar.update()
    return figures


def mean(figures, method, key):
    """Mean over the scenes that have a value, and how many those are; (None, 0) if none has."""
    values = [of[method][key] for of in figures.values() if of[method] and of[method][key] is not None]
    return (math.fsum(values) / len(values), len(values)) if values else (None, 0)


def table(figures, key):
    """Markdown: rows scenes, columns methods; the last row has the mean and how many scenes it covers."""
    title, form = MEASURES[key]
    columns = list(next(iter(figures.values())))

    def cell(value):
        return "-" if value is None else form % value

    rows = [[name] + [cell(of[method] and of[method][key]) for method in columns] for name, of in figures.items()]
    means = [mean(figures, method, key) for method in columns]
    rows.append(["mean (of scenes)"] + ["%s (%d)" % (cell(value), count) for value, count in means])
    return "%s\n\n%s" % (title, steps.table(["scene"] + columns, rows))


def main():
    parser, args = parse_arguments()
    try:
        paths = args.scenes + (suite.generate(args.generate, args.suite) if args.generate else [])
        if not paths:
            parser.error("give scene folders or --generate DIR")
        scenes = {os.path.basename(os.path.abspath(path)): path for path in paths}
        if len(scenes) < len(paths):
            parser.error("two scenes have the same name")
        figures = measure_all(args, scenes)
        print("\n".join(table(figures, key) for key in MEASURES if args.time or key != "seconds_per_frame"), end="")
        if args.json:
            means = {method: {key: mean(figures, method, key) for key in MEASURES} for method in args.methods}
            with open(args.json, "w", encoding="utf-8") as file:
                json.dump({"scenes": figures, "mean_and_scenes": means}, file, indent=2)
                file.write("\n")
    except (ValueError, OSError, subprocess.CalledProcessError) as error:
        parser.error(error)


if __name__ == "__main__":
    main()
