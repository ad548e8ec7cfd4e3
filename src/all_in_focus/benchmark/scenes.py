# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scenes: a focus bracket on disk, and whatever is known about it."""
import glob
import hashlib
import os
import re
from dataclasses import dataclass, field
from typing import Dict, List

import cv2

from all_in_focus.metrics.images import MIN_SIZE
from all_in_focus.metrics.truth import enlargement
from all_in_focus.files.rig import Optics, load_rig
from all_in_focus.files.stack import IMAGE_SUFFIXES, Stack, StackError, load_focus, read_depth, read_image, size_text

VIDEO_SUFFIXES = (".avi", ".mp4", ".mkv", ".mov")
# Where a scene folder may hold what is known beside its frames; of several names the first that is there counts.
BESIDE = {"label": ("label.png", "label_map.png", "label_front.png"), "depth": ("depth.png", "depth_raw.png"),
          "registered_depth": ("registered_depth.png",), "rig": ("rig",), "focus": ("focus.yaml",),
          "truth": ("truth.png",), "truth_depth": ("truth_depth.png",)}
GIVEN = "fused_"  # fused_NAME.png: what another program has made of the scene
RIG_FILES = ("depth.yaml", "color.yaml", "extrinsics.yaml", "optics.yaml")


class SceneError(ValueError):
    """A scene that cannot be used; the message is one line and names the file."""


@dataclass
class Scene:
    """A bracket. stack: folder or video of its frames; sources: its frames, where a folder holds other pictures too.

    beside: paths by the keys of BESIDE; optics: f,F,coc, or empty; given: results of others, path by name; digest: of
    all its files. of_bag: a bracket of a bag; enlarge: see metrics.truth.enlargement; nodes: folder with what the nodes
    have made of it, by mode.
    """
    name: str
    path: str
    stack: str = ""
    sources: List[str] = field(default_factory=list)
    beside: Dict[str, str] = field(default_factory=dict)
    optics: str = ""
    given: Dict[str, str] = field(default_factory=dict)
    digest: str = ""
    of_bag: bool = False
    enlarge: int = 1
    nodes: Dict[str, str] = field(default_factory=dict)

    @property
    def is_bag(self):
        return self.path.endswith(".bag")

    def frames(self):
        """Iterator of BGR images, 8 bit, all of one size; StackError."""
        if self.stack:
            yield from Stack(self.stack)
            return
        first = None
        for path in self.sources:
            image = read_image(path)
            first = image if first is None else first
            if image.shape != first.shape:
                raise StackError(f"{path}: {size_text(image)} pixels, but {self.sources[0]} has {size_text(first)}")
            yield image

    def names(self):
        """A title for each frame."""
        if self.sources:
            return [os.path.basename(path) for path in self.sources]
        stack = Stack(self.stack)
        return stack.names or [f"frame {number}" for number in range(len(stack))]

    def lens(self):
        """Optics: those that are given, else the rig's; None where neither is known."""
        if self.optics:
            return Optics.parse(self.optics)
        return load_rig(self.beside["rig"]).optics if "rig" in self.beside else None

    def files(self):
        """All that the methods see and the measures need."""
        paths = list(self.sources)
        if self.stack and os.path.isdir(self.stack):
            paths += [os.path.join(self.stack, name) for name in Stack(self.stack).names]
        elif self.stack:
            paths.append(self.stack)
        for key, path in self.beside.items():
            paths += [os.path.join(path, name) for name in RIG_FILES] if key == "rig" else [path]
        return [path for path in paths if os.path.exists(path)]


def find(entry):
    """Scenes of an entry of the settings: a folder that is one or holds several, a video, a bag. SceneError."""
    path = entry["path"]
    if not os.path.exists(path):
        raise SceneError(f"{path}: no such scene")
    name = entry.get("name") or _name_of(path)
    if not re.fullmatch(r"[\w.+-]+(/[\w.+-]+)*", name) or any(part.strip(".") == "" for part in name.split("/")):
        raise SceneError(f"{path}: '{name}' is no name for a folder of results: give name")
    if os.path.isfile(path) and path.endswith(".bag"):
        wrong = set(entry) - {"path", "name", "truth"}
        if wrong:
            raise SceneError(f"{path}: a bag has its own {', '.join(sorted(wrong))}")
        return [Scene(name, path, beside=_beside(entry, {"truth": ()}, ""))]
    scene = _scene(name, entry)
    if scene is not None:
        return [scene]
    below = [_scene(_name_of(folder), {"path": folder}) for folder in sorted(glob.glob(os.path.join(path, "*", "")))]
    below = [scene for scene in below if scene is not None]
    if not below:
        raise SceneError(f"{path}: holds no stack/, no source_* pictures, no video and no images")
    if len(entry) > 1:
        raise SceneError(f"{path}: holds several scenes: name one of them to say more about it")
    return below


def _name_of(path):
    """A name for the folder of results: characters that it may not have become underscores."""
    name = os.path.basename(os.path.abspath(path))
    return re.sub(r"[^\w.+-]+", "_", name[:-len(".bag")] if name.endswith(".bag") else name)


def _scene(name, entry):
    """The scene of an entry, None if there are no frames."""
    folder = entry["path"].rstrip("/")
    stack, sources = _frames(entry, folder)
    if not stack and not sources:
        return None
    beside = _beside(entry, BESIDE, folder)
    if "rig" not in beside and os.path.exists(os.path.join(folder, "extrinsics.yaml")):
        beside["rig"] = folder
    given = {os.path.basename(path)[len(GIVEN):-len(".png")]: path
             for path in sorted(glob.glob(os.path.join(glob.escape(folder), GIVEN + "*.png")))}
    return Scene(name, folder, stack, sources, beside, entry.get("optics", ""), given, enlarge=enlargement(folder))


def _beside(entry, known, folder):
    """Paths of what is known beside the frames, from the entry or under the known names."""
    beside = {}
    for key, names in known.items():
        found = [path for path in (os.path.join(folder, name) for name in names) if os.path.exists(path)]
        if key in entry or found:
            beside[key] = entry.get(key) or found[0]
        if key in entry and not os.path.exists(entry[key]):
            raise SceneError(f"{entry[key]}: no such {key.replace('_', ' ')}")
    return beside


def _frames(entry, folder):
    """(stack, sources) of a scene; empty where there is none."""
    for path in (entry.get("stack"), folder if os.path.isfile(folder) else os.path.join(folder, "stack")):
        if path and os.path.exists(path):
            return path, []
        if path and path == entry.get("stack"):
            raise SceneError(f"{path}: no such stack")
    names = sorted(os.listdir(folder))
    images = [name for name in names if name.lower().endswith(IMAGE_SUFFIXES) and not name.startswith((".", GIVEN))]
    videos = [name for name in names if name.lower().endswith(VIDEO_SUFFIXES)]
    sources = [name for name in images if name.startswith("source_")]
    if not sources and len(videos) == 1:
        return os.path.join(folder, videos[0]), []
    known = {name for names in BESIDE.values() for name in names}
    sources = sources or [name for name in images if name not in known]
    return "", [os.path.join(folder, name) for name in sources]


def check(scene):
    """Reads everything once. SceneError, or another ValueError of one line, for what is damaged or does not
    fit. Sets digest."""
    size, count = None, 0
    for image in scene.frames():
        size, count = image.shape, count + 1
    if count < 2:
        raise SceneError(f"{scene.path}: at least two frames are needed, not {count}")
    if min(size[:2]) < MIN_SIZE:
        raise SceneError(f"{scene.path}: frames of {size[1]}x{size[0]} pixels are too small")
    beside = scene.beside
    for key, path in beside.items():
        if key in ("depth", "registered_depth", "truth_depth"):
            read_depth(path)
        if key in ("truth", "truth_depth") and read_image(path, cv2.IMREAD_UNCHANGED).shape[:2] != size[:2]:
            raise SceneError(f"{path}: not of the size of the frames, {size[1]}x{size[0]}")
        if key == "label" and read_image(path, cv2.IMREAD_UNCHANGED).ndim != 2:
            raise SceneError(f"{path}: expected a label map with one channel")
    rig = load_rig(beside["rig"]) if "rig" in beside else None
    if scene.optics:
        Optics.parse(scene.optics)
    if "depth" in beside and rig is None:
        raise SceneError(f"{beside['depth']}: needs a rig, the calibration that registers it")
    if {"depth", "registered_depth"} & set(beside) and not (scene.optics or rig and rig.optics):
        raise SceneError(f"{scene.path}: depth without optics: give optics f,F,coc")
    if "focus" in beside:
        names = Stack(scene.stack).names if scene.stack else [os.path.basename(path) for path in scene.sources]
        load_focus(beside["focus"], names, count)
    scene.digest = digest(scene.files())
    return scene


def digest(paths):
    """Of the contents of files, and their names."""
    total = hashlib.sha256()
    for path in paths:
        total.update(os.path.basename(path).encode() + b"\0")
        with open(path, "rb") as file:
            for block in iter(lambda: file.read(1 << 20), b""):
                total.update(block)
    return total.hexdigest()[:16]
