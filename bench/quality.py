#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fuse scenes by several methods and print, as Markdown tables, how near each comes to the truth; where none is known, or with
--contrast, how much contrast of the sharpest frames each keeps.

Needs a sourced setup.bash. Methods: single, oracle, true-depth (bounds that know the truth); dwt, nsct, im, gf, gf-same,
nsct-pcnn, dsift, dcnn, laplacian, enfuse and each with +ecc (frames aligned first); paper, refined and restored (fuse_stack),
refined:-alignment,exposure (without these steps), refined:no-depth (focus distances alone; restored:no-depth knows the rig,
too), refined:optics+20 (focal length 20 % too long), refined:shift5 (depth 5 pixels to the right); whatever --peer
names (with +ecc: frames aligned first), such as

  --peer 'focus-stack=sh -c "focus-stack --output={output} {stack}/*"'
  --peer 'stackmff+ecc=openfocus --input {stack} --output {output}'     # StackMFF V3, of the Python package openfocus
"""
import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

import steps
from all_in_focus.command_line import Input, Output, Parser, run
from all_in_focus.files.stack import read_image
from all_in_focus.progress import Progress
from all_in_focus_lab.benchmark import methods, scenes, suite, tasks
from all_in_focus_lab.metrics.kept_contrast import kept_contrast

TRUTH = {"psnr": ("PSNR, dB", ".2f"), "ssim": ("SSIM", ".4f"),
         "psnr_edges": ("PSNR within 8 px of depth edges, dB", ".2f")}
CONTRAST = {"kept_contrast": ("Contrast kept, mean of the bands", ".3f"),
            "kept_contrast_least": ("Contrast kept, least band", ".3f")}
SECONDS = {"seconds_per_frame": ("Time per frame, s", ".3f")}
MEASURES = {**TRUTH, **CONTRAST, **SECONDS}


def suites_of(text):
    """argparse type: A,B of the suites."""
    names = text.split(",")
    if not set(names) <= set(suite.SUITES):
        raise argparse.ArgumentTypeError(f"'{text}': there are {', '.join(suite.SUITES)}")
    return names


def parse_arguments():
    parser = Parser(prog="quality.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", type=Input, metavar="SCENE", help="folders that make_scene wrote, or of photos")
    parser.add_argument("--generate", metavar="DIR", help="take scenes of the suites, made in DIR where missing")
    parser.add_argument("--suite", type=suites_of, default=["small"], metavar="A,B",
                        help=f"which of its suites: {', '.join(suite.SUITES)}; default small")
    parser.add_argument("--methods", default="single,oracle,true-depth,gf,gf+ecc,laplacian,laplacian+ecc,paper,refined",
                        metavar="A,B", help="default %(default)s")
    parser.add_argument("--peer", type=methods.peer_command, action="append", default=[], metavar="NAME=COMMAND",
                        help="one more method; in COMMAND {stack} {focus} {rig} {depth} {output} are replaced")
    parser.add_argument("--contrast", action="store_true", help="measure the contrast that is kept where a truth is known, too")
    parser.add_argument("--output", type=Output, required=True, metavar="DIR", help="for DIR/SCENE/METHOD.png")
    parser.add_argument("--keep", action="store_true", help="take results that are there already")
    parser.add_argument("--time", action="store_true", help="print a table of times too")
    parser.add_argument("--json", type=Output, metavar="FILE", help="write the figures there")
    parser.add_argument("--fuse-stack", default=steps.FUSE_STACK, metavar="PATH", help="default: that of scripts/build")
    args = parser.parse_args()
    peers = dict(args.peer)
    args.methods = {name: methods.find(name, peers, args.fuse_stack) for name in methods.split(args.methods) + list(peers)}
    return args


def find_scenes(paths):
    """Scene by name; ValueError for a folder that is none, or two of the same name."""
    found = {Path(path).absolute().name: path for path in paths}
    if len(found) < len(paths):
        raise ValueError("two scenes have the same name")
    return {name: scenes.find({"path": path, "name": name})[0] for name, path in found.items()}


def measure(method, scene, truth, output, args):
    """Figures of one method on one scene; None: no truth or no depth edges, or no time, as the result was there already."""
    seconds, depths = None, {}
    if not (args.keep and output.exists()):
        with tempfile.TemporaryDirectory() as folder:
            begin = time.monotonic()
            produced = method(scene, folder)
            seconds = (time.monotonic() - begin) / len(scene.names())
        cv2.imwrite(str(output), produced.fused)
        depths = tasks.measure_depths(scene, produced.depths)
    image, figures = read_image(output), dict.fromkeys(MEASURES)
    figures["seconds_per_frame"], figures["depths"] = seconds, depths
    figures.update((name.lower(), value) for name, value in tasks.measure_truth(truth, image).items())
    if args.contrast or truth is None:
        shares = kept_contrast(scene.frames(), image)
        figures.update(kept_contrast=float(np.mean(shares)), kept_contrast_least=min(shares))
    return figures


def measure_all(args, found):
    """scene name -> method name -> figures, None where a method failed."""
    figures = {}
    with Progress(total=len(found) * len(args.methods), unit="result") as bar:
        for name, scene in found.items():
            folder = Path(args.output) / name
            folder.mkdir(parents=True, exist_ok=True)
            truth, figures[name] = tasks.truth_of(scene), {}
            for title, method in args.methods.items():
                bar.set_description(f"{name} {title}")
                try:
                    figures[name][title] = measure(method, scene, truth, folder / f"{title}.png", args)
                except (ValueError, RuntimeError, OSError, KeyError, cv2.error) as error:
                    figures[name][title] = None
                    bar.write(f"{name} {title}: {' '.join(str(error).split())}", file=sys.stderr)
                bar.update()
    return figures


def mean(figures, method, key):
    """Mean over the scenes that have a value, and how many those are; (None, 0) if none has."""
    values = [of[method][key] for of in figures.values() if of[method] and of[method][key] is not None]
    return (statistics.fmean(values), len(values)) if values else (None, 0)


def table(figures, key):
    """Markdown: rows scenes, columns methods; the last row has the mean and how many scenes it covers."""
    title, form = MEASURES[key]
    columns = list(next(iter(figures.values())))

    def cell(value):
        return "-" if value is None else format(value, form)

    rows = [[name] + [cell(of[method] and of[method][key]) for method in columns] for name, of in figures.items()]
    means = [mean(figures, method, key) for method in columns]
    rows.append(["mean (of scenes)"] + [f"{cell(value)} ({count})" for value, count in means])
    return f"{title}\n\n{steps.table(['scene'] + columns, rows)}"


def depth_table(figures):
    """Markdown: rows scenes, columns the depth maps that this package's methods used, and what each found; '' for none."""
    given = {"measured": "as measured", "registered": "holes filled"}  # the same for every method that has them
    found = {name: {given.get(key, method): errors for method, figure in of.items() if figure
                    for key, errors in figure["depths"].items()} for name, of in figures.items()}
    found = {name: of for name, of in found.items() if of}
    if not found:
        return ""
    columns = [title for title in [*given.values(), *next(iter(figures.values()))] if any(title in of for of in found.values())]

    def cells(of):
        return [f"{100 * of[title][0]:.2f} / {of[title][1]:.3f}" if title in of else "-" for title in columns]

    shared = {title: [of[title] for of in found.values() if title in of] for title in columns}
    rows = [[name] + cells(of) for name, of in found.items()]
    rows.append(["mean"] + cells({title: np.mean(errors, axis=0) for title, errors in shared.items()}))
    return ("Depth: share wrong by more than 1 px of blur (holes too), % / RMSE without holes, 1/m\n\n"
            + steps.table(["scene"] + columns, rows) + "\n")


def main():
    args = parse_arguments()
    paths = args.scenes + (suite.generate(args.generate, args.suite) if args.generate else [])
    if not paths:
        raise ValueError("give scene folders or --generate DIR")
    found = find_scenes(paths)
    figures = measure_all(args, found)
    known = ["truth" in scene.beside for scene in found.values()]
    shown = {**(TRUTH if any(known) else {}), **(CONTRAST if args.contrast or not all(known) else {}),
             **(SECONDS if args.time else {})}
    tables = [table(figures, key) for key in shown] + [depth_table(figures)]
    print("\n".join(filter(None, tables)), end="")
    if args.json:
        means = {method: {key: mean(figures, method, key) for key in MEASURES} for method in args.methods}
        text = json.dumps({"scenes": figures, "mean_and_scenes": means}, indent=2) + "\n"
        Path(args.json).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    run(main, subprocess.CalledProcessError)
