# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""rviz_screenshots: every display is filled, with the real rviz on a screen of its own; what it says when it cannot."""
import os
import shutil

import cv2
import numpy as np
import pytest

from all_in_focus.bag.writer import write_bag
from all_in_focus.files.rig import Camera, Optics, Rig, load_rig, save_rig
from all_in_focus.files.stack import Stack
from file_helpers import SCRIPTS, focus_file, run, write_stack
from tool_helpers import PREFIX, expect_refusal, succeeded

WIDTH, HEIGHT = 160, 120
# Inside of the panels on the screen of 1600 x 1000: x, y, width, height.
PANELS = {"scene": (500, 250, 500, 500), "all in focus": (1250, 120, 240, 200), "segments": (1250, 430, 240, 200),
          "weights": (1250, 730, 240, 200)}
HAS_RVIZ = all(shutil.which(name) for name in ("xvfb-run", "import", "rviz"))


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Two planes before a camera that focuses on one after the other."""
    folder = tmp_path_factory.mktemp("bag")
    camera = Camera.pinhole("camera", WIDTH, HEIGHT, 200, 200, WIDTH / 2, HEIGHT / 2)
    save_rig(str(folder / "rig"), Rig(camera, camera, np.eye(3), [0, 0, 0], Optics(300.0, 1.8, 0.03), "color", "depth"))
    depth = np.full((HEIGHT, WIDTH), 3500, np.uint16)
    depth[:, :WIDTH // 2] = 2500
    colors = np.random.default_rng(1).integers(0, 255, (HEIGHT // 4, WIDTH // 4, 3), np.uint8)
    sharp = cv2.resize(colors, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
    blurred = cv2.GaussianBlur(sharp, (0, 0), 1)  # such a lens makes discs of 3.8 pixels there
    frames = [sharp.copy(), sharp.copy()]
    frames[0][:, WIDTH // 2:] = blurred[:, WIDTH // 2:]
    frames[1][:, :WIDTH // 2] = blurred[:, :WIDTH // 2]
    focus = focus_file(folder, "frames: [{file: 0.png, focus_mm: 2500}, {file: 1.png, focus_mm: 3500}]")
    path = str(folder / "x.bag")
    write_bag(path, depth, load_rig(folder / "rig"), Stack(write_stack(folder / "stack", ["0.png", "1.png"], frames), focus))
    return path


def rviz_screenshots(*arguments, **options):
    return run([PREFIX / "env.sh", SCRIPTS / "rviz_screenshots", *arguments], **options)


@pytest.mark.skipif(not HAS_RVIZ, reason="xvfb-run, import (ImageMagick) or rviz is missing: scripts/build --with-rviz")
def test_every_display_is_filled(bag, tmp_path):
    succeeded(rviz_screenshots("--bag", bag, "--output", tmp_path / "out"))
    screen = cv2.imread(str(tmp_path / "out" / "rviz.png"))
    assert screen.shape == (1000, 1600, 3)
    for name, (x, y, width, height) in PANELS.items():
        panel = screen[y:y + height, x:x + width].reshape(-1, 3)
        assert panel.std(axis=0).max() > 20, name  # grey level; an empty panel has one colour
        assert len(np.unique(panel, axis=0)) > 50, name
    assert os.listdir(tmp_path / "out") == ["rviz.png"]


def test_what_is_missing_is_named(bag, tmp_path):
    for arguments, missing in ((["--bag", tmp_path / "no.bag", "--output", tmp_path / "out"], "no.bag"),
                               (["--bag", bag], "--output")):
        expect_refusal(rviz_screenshots(*arguments), "rviz_screenshots", missing)
    (tmp_path / "programs").mkdir()
    for name in ("bash", "env"):
        (tmp_path / "programs" / name).symlink_to(shutil.which(name))
    done = run([SCRIPTS / "rviz_screenshots", "--bag", bag, "--output", tmp_path / "out"],
               env=dict(os.environ, PATH=str(tmp_path / "programs")))
    expect_refusal(done, "rviz_screenshots", "xvfb-run is missing: install xvfb, imagemagick and rviz")
    assert not (tmp_path / "out").exists()
