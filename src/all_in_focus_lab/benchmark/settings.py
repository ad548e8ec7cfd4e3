# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is to be evaluated: from a YAML file, from arguments, or both; arguments win."""
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Dict, List

import yaml

from all_in_focus.files import yaml_file
from all_in_focus_lab.benchmark import methods
from all_in_focus_lab.benchmark.scenes import BESIDE
from all_in_focus_lab.metrics import CONTRAST_MEASURES, METRICS

PATH_KEYS = ("path", "stack", *BESIDE)
SCENE_KEYS = (*PATH_KEYS, "name", "optics")
KINDS = {list: "a list", dict: "options and their values", str: "text", int: "a whole number"}  # of values in a file


class SettingsError(ValueError):
    """Settings that make no sense; the message is one line."""


@dataclass
class Settings:
    """scenes: mappings with SCENE_KEYS, at least path; methods: names, see methods.find; metrics: names of METRICS
    (those of CONTRAST_MEASURES are always measured, and may be named too); bag: options of evaluate_bag by name;
    scheduler: address of a running Dask scheduler, or empty: `jobs` processes of this machine (1: this process); peers:
    command lines of other programs by name, see methods.peer_command; fuse_stack: path of another build's, or empty."""
    scenes: List[Dict[str, str]] = field(default_factory=list)
    methods: List[str] = field(default_factory=lambda: ["all"])
    metrics: List[str] = field(default_factory=lambda: list(METRICS))
    output: str = ""
    jobs: int = 1
    scheduler: str = ""
    bag: Dict[str, str] = field(default_factory=dict)
    peers: Dict[str, str] = field(default_factory=dict)
    fuse_stack: str = ""

    def as_yaml(self):
        return yaml.safe_dump(asdict(self), default_flow_style=False, sort_keys=False)


def load(path):
    """Settings from a YAML file with the fields of Settings; its paths are relative to its folder. SettingsError."""
    data = yaml_file.read(path, SettingsError)
    try:
        return from_dict(data, Path(path).absolute().parent)
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}")


def from_dict(data, folder):
    """Settings from a mapping; folder: what relative paths are relative to."""
    if not isinstance(data, dict):
        raise SettingsError("expected keys and values")
    unknown = sorted(set(data) - set(vars(Settings())), key=str)
    if unknown:
        raise SettingsError(f"{unknown[0]}: no such key; there are {', '.join(vars(Settings()))}")
    settings = Settings(**data)
    if isinstance(settings.methods, str):
        settings.methods = methods.split(settings.methods)
    for key, default in vars(Settings()).items():
        if type(getattr(settings, key)) is not type(default):
            raise SettingsError(f"{key}: expected {KINDS[type(default)]}, not '{getattr(settings, key)}'")
    settings.scenes = [scene_entry(entry, folder) for entry in settings.scenes]
    settings.peers = dict(methods.peer_command(f"{name}={command}") for name, command in settings.peers.items())
    settings.bag = {str(name).replace("_", "-"): str(value) for name, value in settings.bag.items()}
    settings.output = str(Path(folder, settings.output)) if settings.output else ""
    return settings


def scene_entry(entry, folder):
    """A scene as a mapping with absolute paths; entry: path or mapping."""
    entry = {"path": entry} if isinstance(entry, str) else entry
    if not isinstance(entry, dict) or "path" not in entry:
        raise SettingsError(f"scenes: expected a path, or a mapping with path, not '{entry}'")
    unknown = sorted(set(entry) - set(SCENE_KEYS), key=str)
    if unknown:
        raise SettingsError(f"scenes: {unknown[0]}: no such key; there are {', '.join(SCENE_KEYS)}")
    for key, value in entry.items():
        if not isinstance(value, str) or not value:
            raise SettingsError(f"scenes: {key}: expected text, not '{value}'")
    return {key: os.path.abspath(Path(folder, value)) if key in PATH_KEYS else value for key, value in entry.items()}


def check_settings(settings):
    """SettingsError for mistakes that can be found without reading files."""
    if not settings.scenes:
        raise SettingsError("no scenes: give folders of pictures or bags")
    if not settings.output:
        raise SettingsError("--output is needed: the folder for the results")
    for name in settings.metrics:
        if name not in (*METRICS, *CONTRAST_MEASURES):
            raise SettingsError(f"no metric is named '{name}'; there are {', '.join((*METRICS, *CONTRAST_MEASURES))}")
    if not settings.metrics or not settings.methods:
        raise SettingsError("at least one method and one metric are needed")
    if len(set(settings.metrics)) < len(settings.metrics):
        raise SettingsError("a metric is named twice")
    if settings.jobs < 1:
        raise SettingsError(f"jobs: expected a positive whole number, not '{settings.jobs}'")
    if settings.scheduler and settings.jobs > 1:
        raise SettingsError("give --jobs or --scheduler: a scheduler has workers of its own")
