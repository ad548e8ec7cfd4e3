#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time registration and segmentation of this package and of others, in turn, and print medians as a Markdown table.

Registration: nodelet depth_image_proc/register, same images through a ROS master of its own. Segmentation: graph
segmentation of OpenCV's contrib and of scikit-image, one thread each. A program that is not installed has `not
installed` in its row. Needs a sourced setup.bash and bench_steps (see docs/lab/performance.md).
"""
import argparse
import json
import os
import struct
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import rospkg
import rospy
from skimage.segmentation import felzenszwalb

import graph_source
import ros_run
import steps
from all_in_focus.command_line import Parser, count, run as run_program
from all_in_focus.files.rig import load_rig
from all_in_focus.files.stack import read_depth
from all_in_focus.installed import find, run
from all_in_focus_lab.benchmark.tables import markdown

TASKS = ("registration", "segmentation")
NOISE_MM = 3
NOT_INSTALLED = "not installed"

FRAMES, RATE = 100, 30
NODE = "registration"

# Class of the nodelet, topic of its result, remappings, parameters.
NODELETS = {
    "depth_preprocess (refined)": ("all_in_focus/depth_preprocess", "depth_registered/image", [], {"mode": "refined"}),
    "depth_preprocess (paper)": ("all_in_focus/depth_preprocess", "depth_registered/image", [], {"mode": "paper"}),
    "depth_image_proc/register": ("depth_image_proc/register", "depth_registered/image_rect",
                                  ["depth/image_rect:=depth/image_raw"], {}),
}


def parse_arguments():
    parser = Parser(prog="compare.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", help="rig folder; default: that of make_scene's planes, 640x480")
    parser.add_argument("--depth", help="depth image of its depth camera; default: that of the scene")
    parser.add_argument("--tasks", default=",".join(TASKS), metavar="A,B", help="default %(default)s")
    parser.add_argument("--repetitions", type=count, default=5, metavar="N", help="default %(default)s")
    parser.add_argument("--bench-steps", default=steps.BENCH_STEPS, metavar="PATH")
    args = parser.parse_args()
    args.tasks = args.tasks.split(",")
    if not set(args.tasks) <= set(TASKS):
        parser.error(f"--tasks: expected some of {','.join(TASKS)}")
    if (args.rig is None) != (args.depth is None):
        parser.error("give --rig and --depth together")
    return args


def rows(task, medians, ours):
    """Table rows; `ours` names what the others are compared with."""
    for name, value in medians.items():
        if value is None:
            yield [task, name, NOT_INSTALLED, ""]
        else:
            yield [task, name, steps.number(value), steps.number(value / medians[ours])]


def elapsed_ms(function, *arguments):
    begin = time.perf_counter()
    function(*arguments)
    return 1000 * (time.perf_counter() - begin)


# --- segmentation -----------------------------------------------------------------------------------------------------

def own_segmentation(args, step, size):
    """Milliseconds, inside one process whose buffers are warm."""
    name = f"segment/{step}"
    figures = steps.run(args.bench_steps, f"{name}/width:{size[0]}/height:{size[1]}/threads:1/", 1, (args.rig, args.depth),
                        0.05)
    if not figures:
        raise RuntimeError(f"bench_steps does not know the size {size[0]}x{size[1]}")
    return figures[(name, *size, 1)]["ms"]


def opencv_segmentation(depth):
    if not hasattr(cv2, "ximgproc"):
        return None
    segmentation = cv2.ximgproc.segmentation.createGraphSegmentation(sigma=0.5, k=300, min_size=10)
    return lambda: elapsed_ms(segmentation.processImage, np.float32(depth))


def skimage_segmentation(depth):
    return lambda: elapsed_ms(lambda: felzenszwalb(np.float64(depth), scale=300, sigma=0.5, min_size=10))


def compare_segmentation(args):
    camera = load_rig(args.rig).color
    size = (camera.width, camera.height)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        stack, filled = folder / "stack", folder / "filled.png"
        stack.mkdir()
        cv2.imwrite(str(stack / "0.png"), np.zeros((*size[::-1], 3), np.uint8))
        run([find("fuse_stack"), "--stack", stack, "--rig", args.rig, "--depth", args.depth, "--output", folder / "fused.png",
             "--save-registered", filled])
        depth = read_depth(filled)
    noisy = graph_source.with_noise(depth, NOISE_MM, np.random.default_rng(0))
    cv2.setNumThreads(1)
    for step, image, title in (("kinect", depth, "segmentation, ms"),
                               ("noisy", noisy, f"segmentation, {NOISE_MM} mm noise, ms")):
        programs = {f"segment_depth ({mode})": lambda mode=mode: own_segmentation(args, mode + "_" + step, size)
                    for mode in ("refined", "paper")}
        programs["OpenCV GraphSegmentation"] = opencv_segmentation(image)
        programs["scikit-image felzenszwalb"] = skimage_segmentation(image)
        yield from rows(title, steps.in_turn(programs, args.repetitions, title), "segment_depth (refined)")


# --- registration -----------------------------------------------------------------------------------------------------

def register(ros, source, nodelet, topic, remappings, parameters):
    """CPU time a frame, latency, in ms, of a nodelet that is alone in a process. source: the command that sends the images."""
    for name, value in parameters.items():
        rospy.set_param(f"/{NODE}/{name}", value)
    process = ros.start([ros_run.program("nodelet", "nodelet"), "standalone", nodelet, "__name:=" + NODE, *remappings])
    latencies = []
    subscriber = rospy.Subscriber(topic, rospy.AnyMsg, lambda m: latencies.append(age_ms(m)), queue_size=FRAMES)
    try:
        playing = subprocess.Popen(source, stdout=subprocess.PIPE, universal_newlines=True)
        time.sleep(2)  # until it is up; images come later still
        before = ros_run.cpu_seconds(process.pid)
        said = playing.stdout.readline()
        if not said or json.loads(said)["sent"] != FRAMES:
            raise RuntimeError(f"{nodelet}: the cameras could not be played")
        time.sleep(0.3)
        cpu = ros_run.cpu_seconds(process.pid) - before
        playing.wait(60)
    finally:
        subscriber.unregister()
        ros.stop(process)
    if len(latencies) < FRAMES // 2:
        raise RuntimeError(f"{nodelet}: {len(latencies)} results for {FRAMES} images")
    return 1000 * cpu / len(latencies), float(np.median(latencies))


def age_ms(message):
    """Of a message that begins with a Header: sequence number, seconds, nanoseconds."""
    _, seconds, nanoseconds = struct.unpack_from("<3I", message._buff)
    return (rospy.Time.now() - rospy.Time(seconds, nanoseconds)).to_sec() * 1000


def compare_registration(args):
    source = [sys.executable, graph_source.__file__, "--rig", args.rig, "--depth", args.depth, "--depth-only", "--rate",
              str(RATE), "--frames", str(FRAMES)]
    packages = rospkg.RosPack().list()
    with ros_run.Ros() as ros:
        rospy.init_node("compare", disable_signals=True)
        programs = {name: partial(register, ros, source, *nodelet) if nodelet[0].split("/")[0] in packages else None
                    for name, nodelet in NODELETS.items()}
        medians = steps.in_turn(programs, args.repetitions, "registration")
    for i, title in enumerate(("registration, CPU time of the process a frame, ms", "registration, from stamp to result, ms")):
        yield from rows(title, {name: None if value is None else value[i] for name, value in medians.items()},
                        "depth_preprocess (refined)")


def main():
    args = parse_arguments()
    compare = {"registration": compare_registration, "segmentation": compare_segmentation}
    with tempfile.TemporaryDirectory() as folder:
        if args.rig is None:
            scene = Path(folder) / "scene"
            subprocess.run([sys.executable, find("make_scene"), "--scene", "planes", "--size", "640x480", "--output", scene],
                           check=True, stdout=subprocess.DEVNULL)
            args.rig, args.depth = str(scene / "rig"), str(scene / "depth.png")
        compared = [row for task in args.tasks for row in compare[task](args)]
    print(f"Medians of {args.repetitions} runs, in turn.\n")
    print(markdown([["task", "program", "median", "times ours"], *compared], left=2))
    sys.stdout.flush()
    os._exit(0)  # rospy's threads may take long


if __name__ == "__main__":
    run_program(main, KeyError, RuntimeError, subprocess.SubprocessError, cv2.error)
