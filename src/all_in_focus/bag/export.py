# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Brackets of a bag as files that fuse_stack takes: stack/000.png ..., focus.yaml, depth.png, rig/."""
import errno
import os
import re
import shlex
import shutil
import sys
from dataclasses import dataclass, field
from typing import List, Optional

import cv2
import numpy as np
import yaml
from tqdm import tqdm

from all_in_focus.bag.brackets import Rules, assemble
from all_in_focus.bag.file import BagError
from all_in_focus.bag.images import ImageError, bgr, check_color, depth_mm
from all_in_focus.bag.rig import RigProblem, camera_at, color_frame, depth_problem, optics_at, pose
from all_in_focus.bag.scan import fetch, scan
from all_in_focus.files.output_file import named
from all_in_focus.files.rig import Optics, Rig, save_rig

DEFAULT_OPTICS = "24,4,0.019"  # of the segmenter
OWN = re.compile(r"stack|rig|focus\.yaml|depth\.png|fused\.png|bracket_\d{4,}")


@dataclass
class Options:
    """invalid_values: mm that mean unknown; optics: instead of those in the bag."""
    rules: Rules = field(default_factory=Rules)
    invalid_values: tuple = (0,)
    optics: Optional[Optics] = None


@dataclass
class Exported:
    """folder: of a bracket; command: list, what fuses it; remarks: what is missing and why, one line each."""
    folder: str
    command: List[str]
    remarks: List[str]


def export(bag, output, which, options, force=False):
    """Write bracket number `which` of a BagFile into `output`; all brackets into output/bracket_0000 and so on if it is
    None. Returns a list of Exported. On any error nothing is left behind and what was there stays.

    force: replace an earlier export. BagError, OSError.
    """
    _check_output(output, force)
    if not bag.has("rgb"):
        raise BagError("%s: no colour image: nothing on %s" % (bag.path, bag.topics["rgb"]))
    found = scan(bag)
    brackets = assemble(found, options.rules, [head for head in found.depth if not depth_problem(found, head)]).found
    if not brackets:
        raise BagError("%s: no colour image belongs to a bracket: see check_bag" % bag.path)
    if which is not None and which >= len(brackets):
        raise BagError("%s: there is no bracket %d: it has %d, counted from 0" % (bag.path, which, len(brackets)))
    chosen = {"bracket_%04d" % number: bracket for number, bracket in enumerate(brackets)}
    if which is not None:
        chosen = {"": brackets[which]}

    folder, name = os.path.split(os.path.abspath(output))
    working = os.path.join(folder, ".%s.%d" % (name, os.getpid()))
    try:
        exported = []
        with named(output, working), tqdm(total=sum(len(bracket.frames) for bracket in chosen.values()), unit="frame",
                                          disable=not sys.stderr.isatty()) as bar:
            os.mkdir(working)
            for part, bracket in chosen.items():
                writer = _Writer(bag, found, bracket, options, os.path.join(working, part))
                exported.append(writer.write(os.path.join(output, part) if part else output, bar))
            _put_in_place(working, output)
    finally:
        shutil.rmtree(working, ignore_errors=True)
    return exported


def _check_output(output, force):
    if not os.path.lexists(output):
        return
    if not os.path.isdir(output) or os.path.islink(output):
        raise NotADirectoryError(errno.ENOTDIR, "is no folder", output)
    names = sorted(os.listdir(output))
    if names and not force:
        raise FileExistsError(errno.EEXIST, "is not empty: choose another folder; --force replaces an earlier export",
                              output)
    for name in names:
        if not OWN.fullmatch(name):
            raise FileExistsError(errno.EEXIST, "is no work of bag_to_stack, not even --force replaces its folder",
                                  os.path.join(output, name))


def _put_in_place(working, output):
    old = working + ".old"
    if os.path.isdir(output):
        os.rename(output, old)
    try:
        os.rename(working, output)
    except OSError:
        if os.path.isdir(old):
            os.rename(old, output)
        raise
    shutil.rmtree(old, ignore_errors=True)


class _Writer:
    """One bracket into one folder."""

    def __init__(self, bag, found, bracket, options, folder):
        self._bag, self._scan, self._bracket, self._options, self._folder = bag, found, bracket, options, folder
        self._digits = max(3, len(str(bracket.frames[-1].index)))  # frames go in the order of their names
        self._remarks = []

    def write(self, target, bar):
        """target: where the folder will be."""
        os.makedirs(os.path.join(self._folder, "stack"))
        written = self._write_frames(bar)
        parts = ["rosrun", "all_in_focus", "fuse_stack", "--stack", os.path.join(target, "stack")]
        if self._write_depth_and_rig():
            parts += ["--depth", os.path.join(target, "depth.png"), "--rig", os.path.join(target, "rig")]
            if not os.path.exists(os.path.join(self._folder, "rig", "optics.yaml")):
                parts += ["--optics", DEFAULT_OPTICS]
        if self._write_focus(written):
            parts += ["--focus", os.path.join(target, "focus.yaml")]
        position = self._reference(written)
        if position != len(written) // 2:
            parts += ["--reference", str(position)]
        return Exported(target, parts + ["--output", os.path.join(target, "fused.png")], self._remarks)

    def _write_frames(self, bar):
        """Returns the Frames that could be written."""
        written, size = [], None
        for frame in self._bracket.frames:
            bar.update()
            try:
                check_color(frame.head)
                picture = bgr(fetch(self._bag, "rgb", frame.head))
                size = size or picture.shape
                if picture.shape != size:
                    raise ImageError("it is %dx%d, the first is %dx%d" % (*picture.shape[1::-1], *size[1::-1]))
            except ImageError as error:
                self._remarks.append("frame %d left out: %s" % (frame.index, error))
                continue
            self._write_png(os.path.join("stack", self._name(frame)), picture)
            written.append(frame)
        if not written:
            raise BagError("%s: %s" % (self._bag.path, self._remarks[0]))
        missing = self._bracket.missing
        if missing:
            self._remarks.append("the bag lacks %d of %d frames, the first is %d"
                                 % (len(missing), len(missing) + len(self._bracket.frames), missing[0]))
        return written

    def _write_depth_and_rig(self):
        """Whether fuse_stack has what it needs to use the depth."""
        head = self._bracket.depth
        if head is None:
            self._remarks.append("no depth: %s" % self._no_depth())
            return False
        self._write_png("depth.png", depth_mm(fetch(self._bag, "depth", head), self._options.invalid_values))
        order = self._bracket.frames[0].head.order
        try:
            cameras = camera_at(self._scan, "depth", head.order), camera_at(self._scan, "rgb", head.order)
            parent = color_frame(self._scan, head.order)
            found = pose(self._scan, head.frame_id, parent, head.order)
        except RigProblem as error:
            self._remarks.append("no rig, so depth.png is of no use: %s" % error)
            return False
        optics = self._options.optics or optics_at(self._scan, order)
        if optics is None:
            self._remarks.append("the bag does not say what the lens was: the nodes take %s (f,F,coc); --optics"
                                 % DEFAULT_OPTICS)
        rig = Rig(*cameras, found.R, found.t, optics, parent.lstrip("/"), head.frame_id.lstrip("/"))
        save_rig(os.path.join(self._folder, "rig"), rig, found.quaternion)
        return True

    def _no_depth(self):
        if not self._scan.depth:
            return "nothing on %s" % self._bag.topics["depth"]
        problem = depth_problem(self._scan, self._scan.depth[0])
        return problem or "none is at or before the first frame and not older than %g s" % self._options.rules.max_age

    def _write_focus(self, written):
        """Whether distances are known."""
        entries = [{"file": self._name(frame), "focus_mm": millimetres(frame.distance)}
                   for frame in written if frame.distance > 0]
        impossible = sum(frame.distance <= 0 for frame in written)
        if impossible:
            self._remarks.append("%d focus distances are not positive: they count as unknown" % impossible)
        if not entries:
            self._remarks.append("no focus distances are known: no focus.yaml")
            return False
        with open(os.path.join(self._folder, "focus.yaml"), "w", encoding="utf-8") as file:
            file.write("frames:\n")
            file.writelines("- %s" % yaml.safe_dump(entry, default_flow_style=True, width=1000) for entry in entries)
        return True

    def _reference(self, written):
        """Position of the frame whose geometry the nodes keep: the first where they cannot know the length."""
        wanted = self._bracket.announced // 2 or self._bracket.frames[0].index
        return int(np.argmin([abs(frame.index - wanted) for frame in written]))

    def _name(self, frame):
        return "%0*d.png" % (self._digits, frame.index)

    def _write_png(self, name, image):
        if not cv2.imwrite(os.path.join(self._folder, name), image):
            raise OSError(errno.EIO, "cannot be written", os.path.join(self._folder, name))


def millimetres(distance):
    """Number of mm that is `distance` (m) again when divided by 1000, a short one if there is one."""
    mm = distance * 1000
    candidates = (round(mm, 6) if np.isfinite(mm) else mm, mm, np.nextafter(mm, 0), np.nextafter(mm, np.inf))
    return float(next((value for value in candidates if value / 1000 == distance), mm))


def shell(command):
    """A command line to copy."""
    return " ".join(shlex.quote(part) for part in command)
