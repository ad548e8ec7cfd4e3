# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The experiment suite: scenes with known truth that differ in kind, optics, length of the sweep and disturbance."""
import subprocess
import sys
from pathlib import Path

from all_in_focus.files import yaml_file
from all_in_focus.installed import find
from all_in_focus.progress import Progress

_READ = yaml_file.read(Path(__file__).with_name("suites.yaml"), ValueError)
SUITES = {
    **_READ,
    # Each small scene, five times as wide and high. A method that finds the right scale loses nothing by that.
    "enlarged": {name + "_x5": f"{options} --enlarge 5" for name, options in _READ["small"].items() if "--size" not in options},
    # A machine-vision camera without gamma: codes in proportion to light.
    "linear": {name + "_linear": options + " --linear" for name, options in _READ["mild"].items()},
    # For the methods `wrong-lens`: few, for there are 40 of them.
    "wrong_lens": {f"{name}_lens": _READ[of][name] for of, name in (
        ("small", "occluders"), ("small", "slope"), ("noisy", "planes_noise2"), ("mild", "plain_35mm"),
        ("mild", "garden_24mm"), ("small", "motorcycle_2"))},
}


def generate(folder, suites=("small",)):
    """Make the scenes of these suites that are not in `folder` yet; paths of all."""
    scenes = {name: options for suite in suites for name, options in SUITES[suite].items()}
    paths = [str(Path(folder) / name) for name in scenes]
    missing = [(path, options) for path, options in zip(paths, scenes.values()) if not Path(path).exists()]
    for path, options in Progress(missing, unit="scene"):
        size = [] if "--size" in options else ["--size", "640x480"]
        subprocess.run([sys.executable, find("make_scene"), "--output", path] + options.split() + size, check=True)
    return paths
