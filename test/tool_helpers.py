# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""fuse_stack, segment_depth and the programs of the package as they are called at the command line."""
import json
import os
import re
import shutil
import sys
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

import all_in_focus
from all_in_focus.files.output_folder import MARK
from all_in_focus.files.rig import Camera, Optics, Rig, save_rig
from file_helpers import ToolServer, call, environment, fork_script, made_once, run

# The space that the package is imported from: prefix/lib/python3/dist-packages/all_in_focus/__init__.py.
PREFIX = Path(all_in_focus.__file__).absolute().parents[4]
SIZE = (64, 48)  # width, height
NEAR, FAR = 1000, 3000  # mm; with OPTICS they never share a region
OPTICS = Optics(24.0, 4.0, 0.019)
HYPERFOCAL = 24.0 ** 2 / (4.0 * 0.019)


def tool(name):
    """Path of a compiled tool."""
    path = PREFIX / "lib" / "all_in_focus" / name
    assert path.is_file(), f"{path} is missing: is {PREFIX} a built space?"
    return path


def run_tool(name, *arguments, **options):
    return run([tool(name), *arguments], **options)


@lru_cache(maxsize=None)
def tool_server(name):
    library = PREFIX / "lib" / f"lib{name}_called.so"
    assert library.is_file(), f"{library} is missing: build the target tests"
    return ToolServer(library)


def fork_tool(name, *arguments):
    """Like run_tool(), but in a fork of a process that has linked OpenCV already."""
    return tool_server(name).run([tool(name), *arguments], dict(os.environ))


def fuse_stack(*arguments):
    return fork_tool("fuse_stack", *arguments)


def segment_depth(*arguments):
    return fork_tool("segment_depth", *arguments)


def rosrun(name, *arguments):
    """A program of the package through rosrun, in the space's own environment, the distribution's Python first."""
    return run([PREFIX / "env.sh", "rosrun", "all_in_focus", name, *arguments], env=environment())


def succeeded(done):
    assert done.returncode == 0, done.stderr
    return done


def snapshot(folder):
    """Everything below a folder: path -> content, None for a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
            for path in Path(folder).rglob("*")}


@contextmanager
def unchanged(folder):
    """What is done meanwhile leaves every file of the folder as it is, and adds none, not even a temporary one."""
    before = snapshot(folder)
    yield
    assert snapshot(folder) == before


def expect_refusal(done, name, complaint=""):
    """Exit code 2, nothing on stdout, one line on stderr that begins with the tool's name."""
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    assert done.stdout == ""
    said = done.stderr
    if tuple(map(int, cv2.__version__.split(".")[:2])) < (4, 6):  # which cannot silence FFmpeg
        said = re.sub(r"^\[.* @ 0x[0-9a-f]+\] .*\n", "", said, flags=re.MULTILINE)
    assert said.count("\n") == 1 and said.endswith("\n"), said
    assert said.startswith(f"{name}: ") and complaint in said, said


def read(path):
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return image


def write(path, image):
    assert cv2.imwrite(str(path), image)
    return path


def read_report(path):
    return json.loads(Path(path).read_text())


def without_timings(report):
    return {name: value for name, value in report.items() if not name.startswith("timing")}


PEAK = "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, stderr=subprocess.DEVNULL); " \
       "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"


def peak_mb(*arguments):
    """Peak memory of fuse_stack, in MB; measured beside a small Python: a forked child begins with its parent's."""
    return int(succeeded(run([sys.executable, "-c", PEAK, tool("fuse_stack"), *arguments])).stdout) / 1024


def texture(size=SIZE, seed=0):
    """Random colours: sharp everywhere."""
    return np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3)).astype(np.uint8)


class TwoPlanes:
    """Left half near, right half far; frame 1 of 3 is sharp on the left, frame 2 on the right, frame 0 nowhere.

    truth, blurred: the picture; frames; depth: 16-bit mm; folder: rig/ (both cameras in one place, the colour camera's
    size), depth.png, stack/, out/, which is empty.
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        self.truth = texture()
        self.blurred = cv2.GaussianBlur(self.truth, (0, 0), 2)
        half = SIZE[0] // 2
        left = np.arange(SIZE[0]) < half
        self.left = np.broadcast_to(left, (SIZE[1], SIZE[0]))
        self.depth = np.where(self.left, NEAR, FAR).astype(np.uint16)
        self.frames = [self.blurred, np.where(self.left[..., None], self.truth, self.blurred),
                       np.where(self.left[..., None], self.blurred, self.truth)]
        self.stack, self.rig = self.folder / "stack", self.folder / "rig"
        self.stack.mkdir(parents=True)
        (self.folder / "out").mkdir()
        for index, frame in enumerate(self.frames):
            write(self.stack / f"{index:02d}.png", frame)
        self.depth_file = write(self.folder / "depth.png", self.depth)
        camera = Camera.pinhole("camera", *SIZE, 60.0, 60.0, 31.5, 23.5)
        save_rig(str(self.rig), Rig(camera, camera, np.eye(3), [0.0, 0.0, 0.0], OPTICS, "color", "depth"))

    @property
    def with_depth(self):
        return ["--depth", self.depth_file, "--rig", self.rig]

    def output(self, name):
        return self.folder / "out" / name

    def clean_output(self):
        shutil.rmtree(self.folder / "out", ignore_errors=True)
        (self.folder / "out").mkdir()

    def refused(self, complaint, *arguments, stack=None, output="old.png", prefix=(), **options):
        """prefix, options: of a process of its own."""
        command = ["--stack", stack or self.stack, "--output", self.output(output), "--report", self.output("new.json"),
                   *arguments]
        with unchanged(self.folder):
            done = run([*prefix, tool("fuse_stack"), *command], **options) if prefix or options else fuse_stack(*command)
            expect_refusal(done, "fuse_stack", complaint)

    def refused_by_segment_depth(self, complaint, *arguments, depth=None, optics="24,4,0.019", output="old.png"):
        with unchanged(self.folder):
            done = segment_depth("--depth", depth or self.depth_file, "--optics", optics, "--output", self.output(output),
                                 "--report", self.output("new.json"), *arguments)
            expect_refusal(done, "segment_depth", complaint)


def made_scene(*options):
    """Folder as make_scene writes it, the same for all tests: to be read only."""
    return made_once(lambda folder: succeeded(call("make_scene", *options, "--output", folder)), "scene", *options)


class MadeScene:
    """A folder as make_scene writes it, made if it is not there. files: arguments of fuse_stack and make_bag."""

    def __init__(self, folder, frames):
        self.folder, self.rig, self.stack = folder, folder / "rig", folder / "stack"
        self.focus, self.depth = folder / "focus.yaml", folder / "depth.png"
        self.files = ["--stack", self.stack, "--focus", self.focus, "--depth", self.depth, "--rig", self.rig]
        if not folder.exists():
            shutil.copytree(str(made_scene("--scene", "planes", "--size", "160x120", "--frames", frames)), str(folder))

    def fused(self, *options):
        """What fuse_stack makes of it."""
        succeeded(run_tool("fuse_stack", *self.files, "--output", self.folder / "fused.png", *options))
        return read(self.folder / "fused.png")


def boards():
    """Depth and picture of boards before a wall; nothing in it is symmetric."""
    depth, light = np.full((480, 640), 3000, np.uint16), np.full((480, 640, 3), 120, np.uint8)
    for number, (x, y, width, height) in enumerate([(40, 60, 90, 300), (190, 20, 60, 200), (300, 240, 110, 180)]):
        depth[y:y + height, x:x + width] = 900 + 300 * number
        light[y:y + height, x:x + width] = 60 + 70 * number
    return depth, light + texture((640, 480)) // 20


def set_up_boards(planes, turn=1):
    """Boards instead of two planes, with both cameras at one place. turn: -1 mirrors the depth image."""
    depth, picture = boards()
    camera = Camera.pinhole("camera", 640, 480, 600.0, 600.0, 319.5, 239.5)
    save_rig(str(planes.rig), Rig(camera, camera, np.eye(3), [0.0, 0.0, 0.0], OPTICS, "color", "depth"))
    write(planes.depth_file, np.ascontiguousarray(depth[:, ::turn]))
    for name in planes.stack.iterdir():
        write(name, picture)


# --- the same input on files and as a bag -----------------------------------------------------------------------------

PICTURES = ("fused", "labels", "registered", "source_index", "confidence", "weights")


def fuse(folder, *arguments):
    """Folder with all that fuse_stack writes, under the names that evaluate_bag uses."""
    folder.mkdir()
    saved = [part for picture in PICTURES[1:]
             for part in (f"--save-{picture.replace('_', '-')}", folder / f"{picture}.png")]
    if "restored" in arguments and "--focus" in arguments:
        saved += ["--save-depth", folder / "depth_restored.png"]
    succeeded(fuse_stack(*arguments, *saved, "--output", folder / "fused.png", "--report", folder / "report.json"))
    return folder


def evaluate_bag(folder, bag, *options):
    """Folder with what evaluate_bag makes of the only bracket of a bag."""
    succeeded(fork_script("evaluate_bag", "--bag", bag, "--output", folder, *options))
    assert sorted(path.name for path in folder.iterdir()) == [MARK, "bracket_0000"]
    return folder / "bracket_0000"


def check_equality(evaluated, fused):
    """Same pixels, same report but for what only one of them can know; returns the report."""
    pictures = PICTURES + ("depth_restored",) * (fused / "depth_restored.png").exists()
    assert set(snapshot(fused)) == {"report.json", *(f"{name}.png" for name in pictures)}
    assert set(snapshot(evaluated)) == {*snapshot(fused), "regions.png"}
    different = {}
    for name in pictures:
        one, other = read(evaluated / f"{name}.png"), read(fused / f"{name}.png")
        assert (one.dtype, one.shape) == (other.dtype, other.shape), name
        if not np.array_equal(one, other):
            different[name] = int((one != other).sum())
    assert not different, "values that differ"
    one, other = read_report(evaluated / "report.json"), read_report(fused / "report.json")
    assert set(one) == set(other) - {"files"} | {"header"}
    # Only files have names.
    other["notes"] = [re.sub(r"^(frame \d+) \(.*?\)", r"\1", note) for note in other["notes"]]
    for name in set(other) - {"files", "label_stamp", "timing_names", "timing_ms"}:
        assert one[name] == other[name], name
    return one


# --- the rule and the focus measure, from their formulas --------------------------------------------------------------

def fits(smallest, greatest):
    """The DoF rule of OPTICS, mm, from its definition: the dioptre span is below 1 / H."""
    return 1 / smallest - 1 / greatest < 1 / HYPERFOCAL


def max_dof(smallest, greatest):
    """Equations 9 and 10 of the paper for OPTICS, mm."""
    def term(u):
        return 4.0 * 0.019 * u * u

    back = 24.0 ** 2 - 4.0 * 0.019 * smallest
    return max(term(smallest) / back if back > 0 else np.inf, term(greatest) / (24.0 ** 2 + 4.0 * 0.019 * greatest))


def normalized_variance(gray):
    values = gray.astype(np.float64)
    return ((values - values.mean()) ** 2).sum() / values.sum()
