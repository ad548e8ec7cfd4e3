# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The experiment suite: scenes with known truth that differ in kind, optics, length of the sweep and disturbance."""
import os
import subprocess
import sys

from tqdm import tqdm

MAKE_SCENE = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "scripts", "make_scene")

# Options of make_scene; the widest blur circle, in pixels, beside each. All are 640x480 but the large one.
SUITE = {
    "occluders": "--scene occluders --frames 12 --optics 50,2.8,0.03",                           # 14
    "plain": "--scene plain --frames 10 --optics 50,2,0.03",                                     # 17
    "slope": "--scene slope --frames 12 --optics 50,1.8,0.03",                                   # 24
    "clutter": "--scene clutter --frames 10 --optics 35,2.8,0.03",                               # 10
    "planes": "--scene planes --frames 12 --optics 35,2.8,0.03",                                 # 11
    "motorcycle_2": "--scene motorcycle --frames 2 --optics 50,2,0.03",                          # 7
    "motorcycle_60": "--scene motorcycle --frames 60 --optics 85,1.4,0.03",                      # 17
    "planes_2": "--scene planes --frames 2 --optics 35,4,0.03",                                  # 7
    "motorcycle_noise": "--scene motorcycle --frames 12 --optics 50,1.2,0.03 --noise 5",         # 11
    "motorcycle_breathing": "--scene motorcycle --frames 12 --optics 85,1.8,0.03 --breathing 0.7",  # 13
    "clutter_breathing": "--scene clutter --frames 10 --optics 50,2.8,0.03 --breathing 1 --seed 1",  # 14
    "slope_jitter": "--scene slope --frames 12 --optics 50,2.8,0.03 --exposure-jitter 0.05 --seed 1",  # 16
    "clutter_large": "--scene clutter --frames 6 --size 2208x1242 --optics 35,4,0.03 --seed 2",  # 23
}


def generate(folder):
    """Make the scenes that are not in `folder` yet; paths of all."""
    paths = [os.path.join(folder, name) for name in SUITE]
    missing = [(path, options) for path, options in zip(paths, SUITE.values()) if not os.path.exists(path)]
    for path, options in tqdm(missing, unit="scene", disable=not sys.stderr.isatty()):
        size = [] if "--size" in options else ["--size", "640x480"]
        subprocess.run([sys.executable, MAKE_SCENE, "--output", path] + options.split() + size, check=True)
    return paths
