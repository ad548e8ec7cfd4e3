# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exports brackets of a bag to files that fuse_stack reads: stack/000.png ..., focus.yaml, depth.png, rig/."""
import errno
from pathlib import Path

import numpy as np

from all_in_focus.bag.brackets import assemble
from all_in_focus.bag.bag_file import BagError
from all_in_focus.image_messages import ImageError, bgr, depth_mm
from all_in_focus.bag.recorded_rig import camera_at, color_frame, depth_problem, optics_at, pose
from all_in_focus.bag.scan import scan
from all_in_focus.files.output_file import encode_png
from all_in_focus.files.output_folder import whole_folder
from all_in_focus.files.rig import DEFAULT_OPTICS, Rig, RigError, save_rig
from all_in_focus.files.stack import save_focus, size_text
from all_in_focus.progress import Progress


def export(bag, output, which, rules, invalid_values=(0,), optics=None, force=False):
    """Writes bracket number `which` of a BagFile into `output`; None: all brackets, into output/bracket_0000 and so on.

    Returns for each bracket its folder (Path), the words of the command that fuses it, and what is missing and why, one line
    each. On any error nothing is left behind and what was there stays. invalid_values: mm that mean unknown; optics: to use
    instead of those in the bag; force: whether to replace an earlier export. Raises BagError, OSError.
    """
    if Path(output).is_dir() and any(Path(output).iterdir()) and not force:
        raise FileExistsError(errno.EEXIST, "is not empty: choose another folder; --force replaces an earlier export",
                              str(output))
    if not bag.has("rgb"):
        raise BagError(f"{bag.path}: no colour image: nothing on {bag.topics['rgb']}")
    found = scan(bag)
    brackets = assemble(found, rules, [head for head in found.depth if not depth_problem(found, head)]).found
    if not brackets:
        raise BagError(f"{bag.path}: no colour image belongs to a bracket: see check_bag")
    if which is not None and which >= len(brackets):
        raise BagError(f"{bag.path}: there is no bracket {which}: it has {len(brackets)}, counted from 0")
    chosen = {f"bracket_{number:04d}": bracket for number, bracket in enumerate(brackets)}
    if which is not None:
        chosen = {"": brackets[which]}

    exported = []
    with whole_folder(output, "bag_to_stack", results=["fused.png"]) as working, \
            Progress(total=sum(len(bracket.frames) for bracket in chosen.values()), unit="frame") as bar:
        for part, bracket in chosen.items():
            writer = _BracketWriter(bag, found, bracket, rules.max_age, invalid_values, optics, working / part)
            exported.append(writer.write(Path(output) / part, bar))
    return exported


class _BracketWriter:
    """Writes one bracket into one folder, a Path."""

    def __init__(self, bag, found, bracket, max_age, invalid_values, optics, folder):
        self._bag, self._scan, self._bracket, self._folder = bag, found, bracket, folder
        self._max_age, self._invalid_values, self._optics = max_age, invalid_values, optics
        self._digits = max(3, len(str(bracket.frames[-1].index)))  # names sort like the frames
        self._warnings = []

    def write(self, target, bar):
        """What export() returns for it. target: the place of the folder in the end, a Path."""
        (self._folder / "stack").mkdir(parents=True)
        written = self._write_frames(bar)
        parts = ["rosrun", "all_in_focus", "fuse_stack", "--stack", str(target / "stack")]
        if self._write_depth_and_rig():
            parts += ["--depth", str(target / "depth.png"), "--rig", str(target / "rig")]
            if not (self._folder / "rig" / "optics.yaml").exists():
                parts += ["--optics", str(DEFAULT_OPTICS)]
        if self._write_focus(written):
            parts += ["--focus", str(target / "focus.yaml")]
        # That of the nodes: the middle one, or the first where the length is unknown.
        wanted = self._bracket.announced // 2 or self._bracket.frames[0].index
        position = int(np.argmin([abs(frame.index - wanted) for frame in written]))
        if position != len(written) // 2:
            parts += ["--reference", str(position)]
        return target, parts + ["--output", str(target / "fused.png")], self._warnings

    def _write_frames(self, bar):
        """Returns the Frames that could be written."""
        written, size = [], None
        for frame in self._bracket.frames:
            bar.update()
            try:
                picture = bgr(self._bag.read_at(frame.head.place), deep=True)
                size = size or picture.shape
                if picture.shape != size:
                    raise ImageError(f"it is {size_text(picture)}, the first is {size[1]}x{size[0]}")
            except ImageError as error:
                self._warnings.append(f"frame {frame.index} left out: {error}")
                continue
            self._write_png(f"stack/{self._name(frame)}", picture)
            written.append(frame)
        if not written:
            raise BagError(f"{self._bag.path}: {self._warnings[0]}")
        missing = self._bracket.missing
        if missing:
            self._warnings.append(f"the bag lacks {len(missing)} of {len(missing) + len(self._bracket.frames)} "
                                  f"frames, the first is {missing[0]}")
        return written

    def _write_depth_and_rig(self):
        """Returns whether fuse_stack gets all that it needs to use the depth."""
        head = self._bracket.depth
        if head is None:
            why = f"none is at or before the first frame and not older than {self._max_age:g} s"
            if self._scan.depth:
                why = depth_problem(self._scan, self._scan.depth[0]) or why
            self._warnings.append(f"no depth: {why if self._scan.depth else 'nothing on ' + self._bag.topics['depth']}")
            return False
        self._write_png("depth.png", depth_mm(self._bag.read_at(head.place), self._invalid_values))
        order = self._bracket.frames[0].head.order
        try:
            cameras = camera_at(self._scan, "depth", head.order), camera_at(self._scan, "rgb", head.order)
            parent = color_frame(self._scan, head.order)
            found = pose(self._scan, head.frame_id, parent, head.order)
        except RigError as error:
            self._warnings.append(f"no rig, so depth.png is of no use: {error}")
            return False
        optics = self._optics or optics_at(self._scan, order)
        if optics is None:
            self._warnings.append(f"the bag does not say what the lens was: the nodes take {DEFAULT_OPTICS} "
                                  "(f,F,coc); --optics")
        save_rig(self._folder / "rig", Rig(*cameras, found.R, found.t, optics, parent.lstrip("/"), head.frame_id.lstrip("/"),
                                           found.quaternion))
        return True

    def _write_focus(self, written):
        """Returns whether any focus distance is known."""
        known = [frame for frame in written if frame.distance > 0]
        impossible = sum(frame.distance <= 0 for frame in written)
        if impossible:
            self._warnings.append(f"{impossible} focus distances are not positive: they count as unknown")
        if not known:
            self._warnings.append("no focus distances are known: no focus.yaml")
            return False
        save_focus(self._folder / "focus.yaml", map(self._name, known), [millimetres(frame.distance) for frame in known])
        return True

    def _name(self, frame):
        return f"{frame.index:0{self._digits}d}.png"

    def _write_png(self, name, image):
        (self._folder / name).write_bytes(encode_png(image))


def millimetres(distance):
    """Number of mm that gives exactly `distance` (m) when divided by 1000; the shortest such number."""
    mm = distance * 1000
    candidates = (round(mm, 6) if np.isfinite(mm) else mm, mm, np.nextafter(mm, 0), np.nextafter(mm, np.inf))
    return float(next((value for value in candidates if value / 1000 == distance), mm))
