# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scenes: a focus bracket on disk, and whatever is known about it; suites of scenes with known truth."""
import hashlib
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Optional

import cv2

from all_in_focus import installed
from all_in_focus.files import yaml_file
from all_in_focus.files.rig import Optics, load_rig
from all_in_focus.files.stack import Stack, is_image_name, load_focus, read_depth, read_image, size_text
from all_in_focus.progress import Progress
from all_in_focus_lab.metrics.images import MIN_SIZE
from all_in_focus_lab.metrics.truth import enlargement

VIDEO_SUFFIXES = (".avi", ".mp4", ".mkv", ".mov")
# Where a scene folder may hold what is known beside its frames; of several names the first that is there counts.
BESIDE = {"label": ("label.png", "label_map.png", "label_front.png"), "depth": ("depth.png", "depth_raw.png"),
          "registered_depth": ("registered_depth.png",), "rig": ("rig",), "focus": ("focus.yaml",),
          "truth": ("truth.png",), "truth_depth": ("truth_depth.png",)}
GIVEN = "fused_"  # fused_NAME.png: what another program has made of the scene
RIG_FILES = ("depth.yaml", "color.yaml", "extrinsics.yaml", "optics.yaml")


@dataclass
class Scene:
    """A bracket. stack: folder or video of its frames; sources: its frames, where a folder holds other pictures too.

    beside: paths by the keys of BESIDE; optics: f,F,coc, or empty; given: results of others, path by name; digest: of
    all its files. of_bag: a bracket of a bag; enlarge: see metrics.truth.enlargement; nodes: folder with what the nodes
    have made of it, by mode.
    """
    name: str
    path: Path
    stack: Optional[Path] = None
    sources: List[Path] = field(default_factory=list)
    beside: Dict[str, Path] = field(default_factory=dict)
    optics: str = ""
    given: Dict[str, Path] = field(default_factory=dict)
    digest: str = ""
    of_bag: bool = False
    enlarge: int = 1
    nodes: Dict[str, Path] = field(default_factory=dict)

    @property
    def is_bag(self):
        return self.path.suffix == ".bag"

    def frames(self):
        """Iterator of BGR images, 8 bit; StackError."""
        return iter(Stack(self.stack)) if self.stack else map(read_image, self.sources)

    def names(self):
        """A title for each frame."""
        if self.sources:
            return [path.name for path in self.sources]
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
        if self.stack:
            paths += Stack(self.stack).files
        for key, path in self.beside.items():
            paths += [path / name for name in RIG_FILES] if key == "rig" else [path]
        return [path for path in paths if path.exists()]


def find(entry):
    """Scenes of an entry of the settings: a folder that is one or holds several, a video, a bag. ValueError."""
    path = Path(entry["path"])
    if not path.exists():
        raise ValueError(f"{path}: no such scene")
    name = entry.get("name") or _name_of(path)
    if not re.fullmatch(r"[\w.+-]+(/[\w.+-]+)*", name) or any(part.strip(".") == "" for part in name.split("/")):
        raise ValueError(f"{path}: '{name}' is no name for a folder of results: give name")
    if path.is_file() and path.suffix == ".bag":
        wrong = set(entry) - {"path", "name", "truth"}
        if wrong:
            raise ValueError(f"{path}: a bag has its own {', '.join(sorted(wrong))}")
        return [Scene(name, path, beside=_beside(entry, {"truth": ()}, path))]
    scene = _scene(name, entry)
    if scene is not None:
        return [scene]
    folders = sorted(folder for folder in path.glob("[!.]*") if folder.is_dir())
    below = [scene for scene in (_scene(_name_of(folder), {"path": folder}) for folder in folders) if scene is not None]
    if not below:
        raise ValueError(f"{path}: holds no stack/, no source_* pictures, no video and no images")
    if len(entry) > 1:
        raise ValueError(f"{path}: holds several scenes: name one of them to say more about it")
    return below


def _name_of(path):
    """A name for the folder of results: characters that it may not have become underscores."""
    return re.sub(r"[^\w.+-]+", "_", path.stem if path.suffix == ".bag" else path.name)


def _scene(name, entry):
    """The scene of an entry, None if there are no frames."""
    folder = Path(entry["path"])
    stack, sources = _frames(entry, folder)
    if not stack and not sources:
        return None
    beside = _beside(entry, BESIDE, folder)
    if "rig" not in beside and (folder / "extrinsics.yaml").exists():
        beside["rig"] = folder
    given = {path.stem[len(GIVEN):]: path for path in sorted(folder.glob(GIVEN + "*.png"))}
    return Scene(name, folder, stack, sources, beside, entry.get("optics", ""), given, enlarge=enlargement(folder))


def _beside(entry, known, folder):
    """Paths of what is known beside the frames, from the entry or under the known names."""
    beside = {}
    for key, names in known.items():
        paths = [Path(entry[key])] if key in entry else [folder / name for name in names]
        found = [path for path in paths if path.exists()]
        if found:
            beside[key] = found[0]
        elif key in entry:
            raise ValueError(f"{entry[key]}: no such {key.replace('_', ' ')}")
    return beside


def _frames(entry, folder):
    """(stack, sources) of a scene; (None, []) where there is none."""
    if "stack" in entry and not Path(entry["stack"]).exists():
        raise ValueError(f"{entry['stack']}: no such stack")
    stack = Path(entry.get("stack") or (folder if folder.is_file() else folder / "stack"))
    if stack.exists():
        return stack, []
    paths = sorted(folder.iterdir())
    images = [path for path in paths if is_image_name(path.name) and not path.name.startswith(GIVEN)]
    videos = [path for path in paths if path.suffix.lower() in VIDEO_SUFFIXES]
    sources = [path for path in images if path.name.startswith("source_")]
    if not sources and len(videos) == 1:
        return videos[0], []
    known = {name for names in BESIDE.values() for name in names}
    return None, sources or [path for path in images if path.name not in known]


def check_scene(scene):
    """Reads everything once, and sets digest. ValueError of one line, which names the file, for what is damaged or does not
    fit."""
    size, count = None, 0
    for name, image in zip(scene.names(), scene.frames()):
        if size and image.shape != size:
            raise ValueError(f"{scene.path / name}: {size_text(image)} pixels, but the first frame has {size[1]}x{size[0]}")
        size, count = image.shape, count + 1
    if count < 2:
        raise ValueError(f"{scene.path}: at least two frames are needed, not {count}")
    if min(size[:2]) < MIN_SIZE:
        raise ValueError(f"{scene.path}: frames of {size[1]}x{size[0]} pixels are too small")
    beside = scene.beside
    for key, path in beside.items():
        if key in ("depth", "registered_depth", "truth_depth"):
            read_depth(path)
        if key in ("truth", "truth_depth") and read_image(path, cv2.IMREAD_UNCHANGED).shape[:2] != size[:2]:
            raise ValueError(f"{path}: not of the size of the frames, {size[1]}x{size[0]}")
        if key == "label" and read_image(path, cv2.IMREAD_UNCHANGED).ndim != 2:
            raise ValueError(f"{path}: expected a label map with one channel")
    rig = load_rig(beside["rig"]) if "rig" in beside else None
    if scene.optics:
        Optics.parse(scene.optics)
    if "depth" in beside and rig is None:
        raise ValueError(f"{beside['depth']}: needs a rig, the calibration that registers it")
    if {"depth", "registered_depth"} & set(beside) and not (scene.optics or rig and rig.optics):
        raise ValueError(f"{scene.path}: depth without optics: give optics f,F,coc")
    if "focus" in beside:
        load_focus(beside["focus"], Stack(scene.stack).names if scene.stack else scene.names(), count)
    scene.digest = digest(scene.files())


def digest(paths):
    """Of the contents of files, and their names."""
    total = hashlib.sha256()
    for path in paths:
        total.update(path.name.encode() + b"\0")
        with path.open("rb") as file:
            for block in iter(lambda: file.read(1 << 20), b""):
                total.update(block)
    return total.hexdigest()[:16]


# --- suites: scenes with known truth that differ in kind, optics, length of the sweep and disturbance -------------------

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


def generate(folder, suites):
    """Make the scenes of these suites that are not in `folder` yet; paths of all."""
    options = {str(Path(folder) / name): options for suite in suites for name, options in SUITES[suite].items()}
    missing = Progress([path for path in options if not Path(path).exists()], unit="scene")
    for path in missing:
        missing.set_description(Path(path).name)
        size = [] if "--size" in options[path] else ["--size", "640x480"]
        installed.run([installed.find("make_scene"), "--output", path, *options[path].split(), *size])
    return list(options)
