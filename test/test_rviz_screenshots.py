# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""rviz_screenshots: every display is filled, with the real rviz on a screen of its own; what it says when it cannot."""
import os
import shutil

import cv2
import numpy as np
import pytest

from all_in_focus.rviz import screenshots as rviz_config
from all_in_focus.bag.writer import write_bag
from all_in_focus.files.rig import Camera, Optics, Rig, save_rig
from all_in_focus.files.stack import Stack
from file_helpers import call, focus_file, run_script, write_stack
from tool_helpers import expect_refusal, succeeded

WIDTH, HEIGHT = 160, 120
# Inside of the panels on the screen of 1600 x 1000: x, y, width, height.
PANELS = {"scene": (500, 250, 500, 500), "all in focus": (1250, 120, 240, 200), "segments": (1250, 430, 240, 200),
          "weights": (1250, 730, 240, 200)}
HAS_RVIZ = all(shutil.which(name) for name in ("Xvfb", "import", "rviz"))


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Two planes before a camera that focuses on one after the other."""
    folder = tmp_path_factory.mktemp("bag")
    camera = Camera.pinhole("camera", WIDTH, HEIGHT, 200, 200, WIDTH / 2, HEIGHT / 2)
    save_rig(str(folder / "rig"), Rig(camera, camera, np.eye(3), [0, 0, 0], Optics(50.0, 1.8, 0.03), "color", "depth"))
    depth = np.full((HEIGHT, WIDTH), 3500, np.uint16)
    depth[:, :WIDTH // 2] = 2500
    colors = np.random.default_rng(1).integers(0, 255, (HEIGHT // 4, WIDTH // 4, 3), np.uint8)
    sharp = cv2.resize(colors, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
    blurred = cv2.GaussianBlur(sharp, (0, 0), 3)
    frames = [sharp.copy(), sharp.copy()]
    frames[0][:, WIDTH // 2:] = blurred[:, WIDTH // 2:]
    frames[1][:, :WIDTH // 2] = blurred[:, :WIDTH // 2]
    focus = focus_file(folder, "frames: [{file: 0.png, focus_mm: 2500}, {file: 1.png, focus_mm: 3500}]")
    path = str(folder / "x.bag")
    write_bag(path, depth, str(folder / "rig"), Stack(write_stack(folder / "stack", ["0.png", "1.png"], frames), focus))
    return path


@pytest.mark.skipif(not HAS_RVIZ, reason="Xvfb, import (ImageMagick) or rviz is missing: scripts/build --with-rviz")
def test_every_display_is_filled(bag, tmp_path):
    succeeded(run_script("rviz_screenshots", "--bag", bag, "--output", tmp_path / "out", "--timeout", 90, timeout=300))
    screen = cv2.imread(str(tmp_path / "out" / "rviz.png"))
    assert screen.shape == (1000, 1600, 3)
    for name, (x, y, width, height) in PANELS.items():
        panel = screen[y:y + height, x:x + width].reshape(-1, 3)
        assert panel.std(axis=0).max() > 20, name  # grey level; an empty panel has one colour
        assert len(np.unique(panel, axis=0)) > 50, name
    assert set(os.listdir(tmp_path / "out")) <= {"rviz.png", "labels.png"}


def test_what_is_missing_is_named(bag, tmp_path):
    done = call("rviz_screenshots", "--bag", tmp_path / "no.bag", "--output", tmp_path / "out")
    expect_refusal(done, "rviz_screenshots", "no.bag")
    broken = tmp_path / "broken.rviz"
    broken.write_text("Visualization Manager: 3\n")
    done = call("rviz_screenshots", "--bag", bag, "--output", tmp_path / "out", "--config", broken)
    expect_refusal(done, "rviz_screenshots", "broken.rviz")
    assert not (tmp_path / "out").exists()


def test_missing_programs_are_named_with_their_packages(bag, tmp_path, monkeypatch):
    from all_in_focus.rviz import virtual_screen
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(virtual_screen.ScreenError, match="Xvfb and rviz missing: install xvfb rviz"):
        virtual_screen.check_programs("Xvfb", "rviz")


def test_topics_of_a_configuration(tmp_path):
    path = tmp_path / "a.rviz"
    path.write_text("""Visualization Manager:
  Global Options: {Fixed Frame: map}
  Displays:
    - {Class: rviz/DepthCloud, Name: cloud, Enabled: true, Depth Map Topic: a/depth, Color Image Topic: a/image}
    - {Class: rviz/Image, Name: picture, Image Topic: a/image}
    - {Class: rviz/Image, Name: off, Enabled: false, Image Topic: b}
    - {Class: rviz/Grid, Name: grid, Enabled: true}
""")
    other = str(tmp_path / "b.rviz")
    rviz_config.write_with_frame(str(path), "color", other)
    for name in (str(path), other):
        assert rviz_config.config_topics(name) == ["a/image", "a/depth", "a/camera_info"]
    assert "Fixed Frame: color" in open(other).read()
