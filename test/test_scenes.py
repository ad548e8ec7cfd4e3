# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Built scenes, their surfaces, and scenes made of any picture with a depth map."""
import json

import cv2
import numpy as np
import pytest
import skimage.data
from file_helpers import run_script

from all_in_focus.simulation import depth_sensor as kinect
from all_in_focus.simulation import lens
from all_in_focus.simulation.layered_scene import LayeredScene
from all_in_focus.simulation.photograph import measured
from all_in_focus.files.rig import Camera, Optics
from all_in_focus.simulation.presets import SCENES
from all_in_focus.simulation.surfaces import Ball, Plane, disc, lit, marked, plain, shaded_under, twigs

OPTICS = Optics(50.0, 1.8, 0.03)
CAMERA = Camera.pinhole("test", 160, 120, 200, 200, 79.5, 59.5)


def white(a, _):
    return np.ones(a.shape + (3,), np.float32), np.ones(a.shape, bool)


@pytest.mark.parametrize("name", sorted(SCENES))
def test_scene_is_seen_by_both_cameras(name):
    scene = SCENES[name].build((160, 120), SCENES[name].optics, 0)
    truth, depth, kinect_view = scene.truth(), scene.truth_depth(), kinect.simulate(scene)
    assert truth.shape == (120, 160, 3) and truth.min() >= 0 and truth.max() <= 1 + 1e-6
    assert depth.min() > 700 and depth.max() < 5500, "outside of what a Kinect measures"
    assert (kinect_view > 0).mean() > 0.65
    sum_of_alpha = sum(layer.crop(*scene.frame_window(0)).alpha for layer in scene.layers)
    assert sum_of_alpha.min() > 0.99, "one can see through it"
    assert depth.max() / depth.min() > 1.5 and truth.std() > 0.05


@pytest.mark.parametrize("name", ["clutter", "occluders", "planes", "slope"])
def test_layers_lie_in_order(name):
    """No surface cuts through one behind it, so that depth and picture tell the same story."""
    scene = SCENES[name].build((160, 120), SCENES[name].optics, 0)
    nearest = np.full(scene.layers[0].depth.shape, np.inf)
    for layer in scene.layers:
        shown = layer.alpha >= 0.5
        behind = np.isfinite(nearest) & shown
        # A thing stands on the ground, one pixel deep in it where its foot is antialiased.
        assert (layer.depth[behind] <= 1.05 * nearest[behind]).all()
        nearest[shown] = layer.depth[shown]


def test_clutter_depends_on_the_seed_only():
    first, again, other = (SCENES["clutter"].build((64, 48), OPTICS, seed).truth() for seed in (1, 1, 2))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_ball_is_round():
    layer = Ball((0.0, 0.0, 2.0), 0.3, white).layer(CAMERA, (0, 0))
    assert layer.depth[60, 80] == pytest.approx(1700, abs=1)
    # The silhouette is the cone that touches the ball: tan = r / sqrt(z^2 - r^2).
    radius = 200 * 0.3 / np.sqrt(2.0 ** 2 - 0.3 ** 2)
    assert layer.alpha.sum() == pytest.approx(np.pi * radius ** 2, rel=0.01)
    assert layer.depth[layer.alpha > 0.99].max() < 2000
    assert layer.color[50, 70].mean() > 1.5 * layer.color[70, 90].mean(), "lit from the upper left"


def test_tilted_plane_is_the_ground():
    """The camera looks down by 30 degrees from 1 m above: its axis meets the ground after 1 / sin 30 m."""
    foot = (0, np.cos(np.radians(30)), np.sin(np.radians(30)))
    layer = Plane(foot, 0, 90, white, tilt=30).layer(CAMERA, (0, 0))
    assert np.interp(59.5, np.arange(120), layer.depth[:, 80]) == pytest.approx(2000, rel=1e-3)
    assert (np.diff(layer.depth[:, 80]) < 0).all()


def test_surface_outside_the_picture_is_refused():
    with pytest.raises(ValueError, match="outside the picture"):
        Plane((50.0, 0.0, 2.0), 0, 0, plain(1, 1, (1, 1, 1))).layer(CAMERA, (0, 0))


def test_shades():
    a, b = (np.float32(axis) for axis in np.meshgrid(np.linspace(-1, 1, 201), np.linspace(-1, 1, 201)))
    assert disc(white, 0.5)(a, b)[1].mean() == pytest.approx(np.pi / 16, rel=0.02)
    marks = marked(white, [(0.5, -0.5, 0.2, 0.1, (0, 0, 0))])(a, b)[0]
    assert marks[50, 150].max() == 0 and marks[150, 50].min() == 1 and marks.mean() == pytest.approx(0.995, abs=1e-3)
    light = lit(white, 0, 0, 1)(a, b)[0]
    assert light[100, 100] == pytest.approx(1) and 0.25 < light.min() < 0.5
    shadow = shaded_under(white, [(0, 0, 0.2)])(a, b)[0]
    assert shadow[100, 100].max() < 0.4 and shadow[0, 0].min() > 0.99
    exists = twigs([(-0.5, 0, 0.5, 0, 0.1, 0.05)], (0.2, 0.1, 0.1))(a, b)[1]
    assert exists[109, 52] and not exists[109, 148] and exists[104, 148] and not exists[115].any()


# --- any picture with a depth map -------------------------------------------------------------------------------------

def test_measured_scene_restores_the_picture():
    image = skimage.data.chelsea()[:120, :160]
    depth = np.full((120, 160), 2000, np.uint16)
    depth[40:80, 60:100] = 1000
    depth[:, 120:130], depth[5] = 0, 0
    scene = measured(image, depth, None, (160, 120), OPTICS, 0)
    assert isinstance(scene, LayeredScene) and np.array_equal(lens.expose(scene.truth()), image)
    assert (scene.truth_depth()[depth > 0] == depth[depth > 0]).all() and scene.truth_depth().min() == 1000
    assert scene.rig.color.K[0, 0] == pytest.approx(160 * 50 / 36)
    assert measured(image, depth, 300.0, (80, 60), OPTICS, 0).rig.color.K[0, 0] == pytest.approx(150)


def test_flat_depth_is_one_layer():
    scene = measured(skimage.data.chelsea()[:48, :64], np.full((48, 64), 1500, np.uint16), None, (64, 48), OPTICS, 0)
    assert len(scene.layers) == 1


def make_picture_scene(tmp_path, *arguments, depth=None, scene="picture"):
    image = skimage.data.coffee()[:96, :128]
    cv2.imwrite(str(tmp_path / "p.png"), image[..., ::-1])
    if depth is None:
        depth = np.uint16(np.linspace(3000, 1000, 96))[:, None].repeat(128, axis=1)
    cv2.imwrite(str(tmp_path / "z.png"), depth)
    files = ("--picture", tmp_path / "p.png", "--depth", tmp_path / "z.png")
    return image, run_script("make_scene", "--scene", scene, "--frames", 2, "--output", tmp_path / "scene",
                             *(arguments if "--picture" in arguments else files + arguments))


def test_program_renders_any_picture(tmp_path):
    image, result = make_picture_scene(tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert np.array_equal(cv2.imread(str(tmp_path / "scene" / "truth.png")), image[..., ::-1])
    made = json.loads((tmp_path / "scene" / "scene.json").read_text())
    assert made["scene"] == "picture" and made["size"] == [128, 96]
    assert (made["near_mm"], made["far_mm"]) == pytest.approx((1000, 3000))


@pytest.mark.parametrize("arguments, options, reason", [
    ((), {"depth": np.zeros((96, 128), np.uint16)}, "the depth map is empty"),
    ((), {"depth": np.ones((96, 100), np.uint16)}, "differ in size: 128x96 and 100x96"),
    ((), {"depth": np.ones((96, 128), np.uint8)}, "expected a 16-bit image"),
    ((), {"depth": np.full((96, 128), 90, np.uint16)}, "too long for a scene that begins at 90 mm"),
    ((), {"scene": "planes"}, "no other scene takes them"),
    (("--picture", "p.png"), {}, "needs --picture and --depth"),
    (("--focal-px", "0"), {}, "expected a positive number"),
])
def test_bad_pictures(tmp_path, arguments, options, reason):
    _, result = make_picture_scene(tmp_path, *arguments, **options)
    assert result.returncode == 2 and result.stderr.count("\n") == 1 and reason in result.stderr
    assert not (tmp_path / "scene").exists()
