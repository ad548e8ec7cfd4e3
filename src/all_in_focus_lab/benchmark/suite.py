# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The experiment suite: scenes with known truth that differ in kind, optics, length of the sweep and disturbance."""
import subprocess
import sys
from pathlib import Path

from all_in_focus.installed import find
from all_in_focus.progress import Progress

# Options of make_scene; the widest blur circle, in pixels, beside each. All are 640x480 but clutter_large.
SMALL = {
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


# 6 and 24 Mpx; the depth camera keeps its 640x480, so that holes and frayed edges are tens of pixels wide.
LARGE = {
    "occluders_6mp": "--scene occluders --frames 12 --size 3000x2000 --optics 50,2.8,0.03 --grain 0.15 --seed 3 --noise 1",  # 66
    "slope_6mp": "--scene slope --frames 12 --size 3000x2000 --optics 50,2.8,0.03 --grain 0.15 --seed 3 --noise 1"
                 " --breathing 0.7 --vignetting 0.3",                                                                   # 72
    "garden_6mp": "--scene garden --frames 12 --size 3000x2000 --optics 45,2.8,0.03 --grain 0.15 --seed 3 --noise 1"
                  " --sag 0.1,4,7",                                                                                     # 66
    "plain_6mp": "--scene plain --frames 12 --size 3000x2000 --optics 50,2,0.03 --seed 3 --noise 2"
                 " --exposure-jitter 0.03 --vignetting 0.3",                                                            # 80
    "planes_24mp": "--scene planes --frames 10 --size 6000x4000 --optics 35,3.5,0.03 --grain 0.15 --seed 3 --noise 2"
                   " --breathing 0.3 --vignetting 0.3 --exposure-jitter 0.02 --sag 0.05,6,10",                          # 80
}

# Each small scene, five times as wide and high. A method that finds the right scale loses nothing by that.
ENLARGED = {name + "_x5": options + " --enlarge 5" for name, options in SMALL.items() if "--size" not in options}

# How many frames are averaged shows in noise, above all on bare surfaces.
NOISY = {
    "plain_noise2": "--scene plain --frames 12 --optics 50,2.4,0.03 --noise 2 --seed 5",
    "plain_noise5": "--scene plain --frames 12 --optics 50,2.4,0.03 --noise 5 --seed 6",
    "slope_noise2": "--scene slope --frames 12 --optics 50,2.4,0.03 --noise 2 --seed 5",
    "clutter_noise2": "--scene clutter --frames 12 --optics 50,2.4,0.03 --noise 2 --seed 5",
    "planes_noise2": "--scene planes --frames 12 --optics 50,2.4,0.03 --noise 2 --seed 5",
    "occluders_noise2": "--scene occluders --frames 12 --optics 50,2.4,0.03 --noise 2 --seed 5",
}

# Thin leaves and stalks, which coarse windows look across; lenses that breathe but hardly blur, where resampling costs most.
THIN_AND_MILD = {
    "garden_noise": "--scene garden --frames 8 --optics 50,2.8,0.03 --noise 3 --breathing 0.8 --vignetting 0.3 --seed 531",
    "garden_jitter": "--scene garden --frames 8 --optics 50,2.8,0.03 --exposure-jitter 0.02 --breathing 0.8 --vignetting 0.3"
                     " --seed 823",
    "garden_sag": "--scene garden --frames 4 --optics 24,2.8,0.03 --noise 1 --sag 0.05,3,4 --seed 352",
    "clutter_mild": "--scene clutter --frames 6 --optics 24,4,0.03 --noise 1 --breathing 0.3 --vignetting 0.3 --seed 693",
    "occluders_mild": "--scene occluders --frames 20 --optics 35,4,0.03 --noise 1 --breathing 0.8 --exposure-jitter 0.05"
                      " --seed 303",
}

# Scenes that stand still, with little blur and noise: much depends on which of two nearly equal frames is taken.
# The widest blur circle, in pixels, beside each.
MILD = {
    "clutter_24mm": "--scene clutter --frames 10 --optics 24,2.8,0.03 --noise 0.7 --seed 11",        # 7
    "clutter_35mm": "--scene clutter --frames 8 --optics 35,4,0.03 --noise 1 --seed 12",             # 7
    "clutter_50mm": "--scene clutter --frames 12 --optics 50,4,0.03 --seed 19",                      # 10
    "clutter_24_frames": "--scene clutter --frames 24 --optics 35,2.8,0.03 --noise 1 --seed 22",     # 9
    "garden_24mm": "--scene garden --frames 8 --optics 24,2.8,0.03 --noise 0.7 --seed 17",           # 7
    "motorcycle_50mm": "--scene motorcycle --frames 8 --optics 50,2.8,0.03 --noise 0.7 --seed 18",   # 5
    "occluders_28mm": "--scene occluders --frames 10 --optics 28,2.8,0.03 --noise 0.7 --seed 14",    # 8
    "plain_35mm": "--scene plain --frames 8 --optics 35,2,0.03 --noise 1 --seed 16",                 # 11
    "planes_24mm": "--scene planes --frames 10 --optics 24,2.8,0.03 --noise 0.7 --seed 13",          # 7
    "planes_20_frames": "--scene planes --frames 20 --optics 35,4,0.03 --noise 2 --seed 21",         # 7
    "slope_35mm": "--scene slope --frames 10 --optics 35,2.8,0.03 --noise 0.7 --seed 15",            # 11
    "slope_24mm": "--scene slope --frames 8 --optics 24,2,0.03 --seed 20",                           # 10
}

# A machine-vision camera without gamma: codes in proportion to light.
LINEAR = {name + "_linear": options + " --linear" for name, options in MILD.items()}

SUITES = {"small": SMALL, "large": LARGE, "enlarged": ENLARGED, "noisy": NOISY, "thin_and_mild": THIN_AND_MILD,
          "mild": MILD, "linear": LINEAR}


def generate(folder, suites=("small",)):
    """Make the scenes of these suites that are not in `folder` yet; paths of all."""
    scenes = {name: options for suite in suites for name, options in SUITES[suite].items()}
    paths = [str(Path(folder) / name) for name in scenes]
    missing = [(path, options) for path, options in zip(paths, scenes.values()) if not Path(path).exists()]
    for path, options in Progress(missing, unit="scene"):
        size = [] if "--size" in options else ["--size", "640x480"]
        subprocess.run([sys.executable, find("make_scene"), "--output", path] + options.split() + size, check=True)
    return paths
