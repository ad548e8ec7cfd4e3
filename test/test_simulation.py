# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Thin-lens brackets, the depth camera, surfaces, and the scenes of make_scene."""
import filecmp
import json
import os
from functools import lru_cache, partial

import cv2
import numpy as np
import pytest
import skimage.data
import yaml

from all_in_focus import imaging
from all_in_focus.files.rig import Camera, Optics, load_rig
from all_in_focus_lab.metrics.truth import Truth
from all_in_focus_lab.simulation import depth_sensor as kinect
from all_in_focus_lab.simulation import lens, surfaces
from all_in_focus_lab.simulation.layered_scene import LayeredScene, add_grain, kinect_beside
from all_in_focus_lab.simulation.photograph import measured, peel_layers
from all_in_focus_lab.simulation.presets import SCENES
from all_in_focus_lab.simulation.surfaces import Ball, Plane, disc, lit, marked, plain, shaded_under, twigs
from file_helpers import call, run_script
from tool_helpers import expect_refusal

OPTICS, BRIGHT_LENS = Optics(50.0, 2.0, 0.03), Optics(50.0, 1.8, 0.03)
CAMERA = Camera.pinhole("test", 160, 120, 200, 200, 79.5, 59.5)
make_scene = partial(call, "make_scene")


def flat(color, depth, alpha=None, size=(80, 120)):
    """A layer of one colour or of a given picture, parallel to the sensor."""
    alpha = np.ones(size, np.float32) if alpha is None else np.float32(alpha)
    color = np.broadcast_to(np.float32(color), size + (3,)).copy()
    return lens.Layer(color, alpha, np.full(size, depth, np.float32), alpha)


def scene_of(*layers, fx=800.0):
    height, width = layers[0].alpha.shape
    camera = Camera.pinhole("dslr", width, height, fx, fx, width / 2, height / 2)
    return LayeredScene("test", kinect_beside(camera, OPTICS), (0, 0), list(layers))


def noise_picture(size=(80, 120)):
    return np.random.default_rng(0).uniform(0, 1, size + (3,)).astype(np.float32)


# --- lens -------------------------------------------------------------------------------------------------------------

def test_blur_circle_of_the_thin_lens():
    optics = Optics(24.0, 4.0, 0.019)
    # 24^2 / 4 * |1000 - 2000| / (1000 * (2000 - 24)) = 144 / 1976
    assert lens.blur_circle_px(optics, 24.0, 1000.0, 2000.0) == pytest.approx(0.0728745, abs=1e-7), "pixels of 1 mm"
    assert lens.blur_circle_px(optics, 24.0, 2000.0, 1000.0) == pytest.approx(0.0737705, abs=1e-7)
    assert lens.blur_circle_px(optics, 24.0, 1500.0, 1500.0) == 0
    assert lens.blur_circle_px(optics, 810.0, 1000.0, 2000.0) == pytest.approx(2.4595, abs=1e-4)
    assert lens.image_distance(50.0, 2050.0) == pytest.approx(51.25)


def test_focus_distances_are_even_in_dioptres():
    distances = lens.focus_distances(800, 4000, 5)
    assert distances[[0, 4]] == pytest.approx([800, 4000])
    assert np.allclose(np.diff(1000 / distances), -0.25)
    assert lens.focus_distances(1000, 3000, 1) == pytest.approx([1500])


def test_disc_kernels():
    for diameter in (0.25, 0.5, 1.0):
        assert lens.blur_levels(np.array(diameter)) == 0
    assert np.array_equal(lens.disc_kernel(0), [[1]])
    for diameter in (1.5, 3.0, 7.25, 20.0):
        kernel = lens.disc_kernel(int(lens.blur_levels(np.array(diameter))))
        offset = np.arange(len(kernel)) - len(kernel) // 2
        assert kernel.sum() == pytest.approx(1, abs=1e-5)
        # a disc has the variance d^2 / 16 per axis; spread over whole pixels, 1 / 12 more
        variance = (kernel.sum(axis=0) * offset ** 2).sum()
        assert variance == pytest.approx(diameter ** 2 / 16 + 1 / 12, abs=0.1)


def test_blur_circle_of_a_rendered_point():
    picture = np.zeros((80, 120, 3))
    picture[40, 60] = 1
    light = lens.render_frame(scene_of(flat(picture, 1000.0)), OPTICS, 2000.0)
    expected = lens.blur_circle_px(OPTICS, 800.0, 1000.0, 2000.0)
    assert expected == pytest.approx(10.256, abs=1e-3)
    assert light[..., 0].sum() == pytest.approx(1, abs=1e-4)
    variance = (light[..., 0].sum(axis=0) * (np.arange(120) - 60) ** 2).sum() - 1 / 12
    assert 4 * np.sqrt(variance) == pytest.approx(expected, abs=0.15)
    assert light[40, 60, 0] == pytest.approx(4 / (np.pi * expected ** 2), rel=0.05)


def test_defocused_occluder_spreads_over_the_sharp_far_side():
    alpha = np.zeros((80, 120))
    alpha[:, :60] = 1
    picture = noise_picture()
    scene = scene_of(flat(picture, 2000.0), flat([1, 1, 1], 1000.0, alpha))
    light = lens.render_frame(scene, OPTICS, 2000.0)
    radius = lens.blur_circle_px(OPTICS, 800.0, 1000.0, 2000.0) / 2
    clear = 60 + int(np.ceil(radius)) + 1
    assert np.allclose(light[:, clear:], picture[:, clear:], atol=1e-5)
    assert np.allclose(light[:, :60 - int(np.ceil(radius)) - 1], 1, atol=1e-5)
    # on the edge half of the lens sees past it: the near white and what really lies behind, half and half
    behind = 0.5 * (light[:, 59] + light[:, 60]) - 0.25 * (picture[:, 59] + picture[:, 60])
    assert behind.mean() == pytest.approx(0.5, abs=0.02)


def test_frame_is_the_truth_where_it_is_focused():
    alpha = np.zeros((80, 120))
    alpha[:, :60] = 1
    scene = scene_of(flat(noise_picture(), 2000.0), flat(noise_picture()[::-1], 1000.0, alpha))
    truth = scene.truth()
    near, far = (np.abs(lens.render_frame(scene, OPTICS, s) - truth).mean(axis=2) for s in (1000.0, 2000.0))
    assert near[:, :60].max() < 1e-5 and near[:, 70:].mean() > 0.1
    assert far[:, 67:].max() < 1e-5 and far[:, :50].mean() > 0.1


@pytest.mark.parametrize("s", [1000.0, 1400.0, 2500.0])
def test_no_fringes_on_a_uniform_scene(s):
    depth = np.full((80, 120), 2500, np.float32)
    depth[20:60, 30:50], depth[:, 80:84], depth[70:] = 1000, 1300, np.linspace(2000, 1500, 10)[:, None]
    color = np.full((80, 120, 3), 0.4, np.float32)
    light = lens.render_frame(scene_of(*peel_layers(color, depth, 3e-5, 20)), OPTICS, s)
    assert np.allclose(light, 0.4, atol=1e-4)


def test_peeled_surface_shows_no_seams():
    """A slanted textured surface, cut into layers, is blurred as if it were whole."""
    color = cv2.GaussianBlur(noise_picture((200, 120)), (0, 0), 1)
    depth = (1 / np.linspace(1 / 3000, 1 / 1500, 200))[:, None].repeat(120, axis=1).astype(np.float32)
    ones = np.ones(depth.shape, np.float32)
    layers = peel_layers(color, depth, (1 / 1500 - 1 / 3000) / 8, 14)
    assert len(layers) in (8, 9)
    for s in (1500.0, 3000.0):
        whole = lens.render_frame(scene_of(lens.Layer(color, ones, depth, ones)), OPTICS, s)
        cut = lens.render_frame(scene_of(*layers), OPTICS, s)
        error = np.sqrt(((whole - cut) ** 2).mean(axis=(1, 2)))
        assert (error < 0.15 * whole.std(axis=(1, 2))).all() and error.mean() < 3e-4


def test_blur_of_a_peeled_object_hides_no_more_than_if_it_were_whole():
    """Black and slanted, before a white wall in focus."""
    near = np.zeros((120, 120), np.float32)
    near[:, :60] = 1
    slope = np.linspace(1000, 1100, 120, dtype=np.float32)[:, None].repeat(120, axis=1)
    whole = [flat([1, 1, 1], 3000.0, size=near.shape), lens.Layer(np.zeros((120, 120, 3), np.float32), near, slope, near)]
    cut = peel_layers(1 - np.dstack([near] * 3), np.where(near > 0, slope, np.float32(3000)), (1 / 1000 - 1 / 1100) / 8, 20)
    assert len(cut) in (9, 10)
    whole, cut = (lens.render_frame(scene_of(*layers), OPTICS, 3000.0) for layers in (whole, cut))
    difference = np.abs(whole - cut)
    assert difference.max() < 0.1 and difference.mean() < 0.004


def test_peeled_layers_restore_the_picture():
    depth = np.full((80, 120), 2500, np.float32)
    depth[20:60, 30:50] = 1000
    scene = scene_of(*peel_layers(noise_picture(), depth, 3e-5, 10))
    assert np.allclose(scene.truth(), noise_picture(), atol=1e-6)
    assert np.array_equal(scene.truth_depth(), depth)
    assert scene.layers[0].alpha[25, 32] == 1 and scene.layers[0].alpha[40, 40] == 1  # goes on behind the box


def test_breathing_and_exposure():
    picture = np.zeros((81, 121, 3))
    picture[40, 20] = picture[40, 100] = 1
    scene = scene_of(flat(cv2.GaussianBlur(picture, (0, 0), 2) * 20, 1000.0, size=(81, 121)))
    distances = [1000.0, 1500.0]
    scale = lens.breathing_scale(50.0, 1000.0, 1500.0, 2.0)
    assert scale == pytest.approx(1 + 2 * ((50000 / 950) / (75000 / 1450) - 1))
    breathing, plain, jitter = (list(lens.render_bracket(scene, OPTICS, distances, lens.Disturbance(**options), seed=3))
                                for options in ({"breathing": 2.0}, {}, {"exposure_jitter": 0.5}))

    def separation(frame):
        light = imaging.srgb_to_linear(frame[..., 0]).sum(axis=0)
        column = np.arange(121)
        return (light * column)[61:].sum() / light[61:].sum() - (light * column)[:60].sum() / light[:60].sum()

    assert separation(breathing[0]) / separation(plain[0]) == pytest.approx(scale, abs=2e-3)
    assert np.array_equal(breathing[1], plain[1]) and np.array_equal(jitter[1], plain[1])
    assert not np.array_equal(jitter[0], plain[0])


def test_motion_rolls_about_the_centre_and_then_shifts():
    matrix = lens.motion((60, 40), scale=1.1, roll=90, shift=(3, -2))
    assert matrix @ [60, 40, 1] == pytest.approx([63, 38])
    assert matrix @ [70, 40, 1] == pytest.approx([63, 38 + 11]), "clockwise: what was right is below"
    picture = cv2.GaussianBlur(noise_picture(), (0, 0), 2)
    assert lens.warp(picture, lens.motion((60, 40))) is picture
    back = lens.warp(lens.warp(picture, matrix), cv2.invertAffineTransform(matrix))
    assert np.abs(back - picture)[25:55, 45:75].max() < 0.01


def test_sagging_head_moves_the_frames_evenly():
    camera = scene_of(flat([0, 0, 0], 1000.0)).rig.color
    motions = list(lens.frame_motions(camera, OPTICS, np.full(5, 1000.0), sag=lens.Sag(2, 4, 8)))
    assert np.array_equal(motions[2], np.eye(2, 3)), "the reference stays"
    centre = [camera.K[0, 2], camera.K[1, 2]]
    assert [tuple(np.round(matrix @ [*centre, 1] - centre, 6)) for matrix in motions] == [
        (-2, -4), (-1, -2), (0, 0), (1, 2), (2, 4)]
    assert np.degrees(np.arctan2(motions[4][1, 0], motions[4][0, 0])) == pytest.approx(1)

    picture = np.zeros((80, 120, 3))
    picture[40, 60] = 1
    scene = scene_of(flat(cv2.GaussianBlur(picture, (0, 0), 2) * 20, 1000.0))
    frames = list(lens.render_bracket(scene, OPTICS, [1000.0] * 3, lens.Disturbance(sag=lens.Sag(0, 6, 10))))
    assert [np.unravel_index(frame[..., 0].argmax(), (80, 120)) for frame in frames] == [(35, 57), (40, 60), (45, 63)]


def test_camera_that_drifts_sees_near_things_move_more():
    path = lens.drift_path(9, 6, seed=3)
    assert not path[4].any() and np.linalg.norm(path, axis=1).max() == pytest.approx(6)
    assert not lens.drift_path(1, 6).any()

    def at(z):
        return Plane((0.0, 0.0, z), 0, 0, disc(plain(1, 1, (0.6, 0.6, 0.6)), 0.02 * z))

    surfaces = [Plane((0.0, 0.0, 5.0), 0, 0, plain(9, 9, (0.1, 0.1, 0.1))), at(2.0), at(1.0)]
    for near in (1, 2):  # one disc at a time before the wall
        shown = [surfaces[0], surfaces[near]]
        rig = kinect_beside(CAMERA, OPTICS)
        scene = LayeredScene("test", rig, (40, 40), [it.layer(CAMERA, (40, 40)) for it in shown], surfaces=shown)
        assert scene.seen_from((0, 0, 0)) is scene
        moved = scene.seen_from((30, -20, 0))
        z = surfaces[near].center[2]
        middle = np.argwhere(moved.truth_depth() < 1000 * z + 1).mean(axis=0)
        # f t / Z against the motion of the camera; the middle of 8 px wide discs of whole pixels is right to 0.1
        assert middle - [59.5, 79.5] == pytest.approx([200 * 0.02 / z, -200 * 0.03 / z], abs=0.1)
        closer = scene.seen_from((0, 0, 100))
        assert closer.truth_depth().min() == pytest.approx(1000 * z - 100)
    with pytest.raises(ValueError, match="built of surfaces"):
        scene_of(flat([0, 0, 0], 1000.0)).seen_from((1, 0, 0))


def test_drift_moves_all_frames_but_the_reference(tmp_path):
    options = ["--scene", "planes", "--frames", 3, "--size", "64x48"]
    assert make_scene("--output", tmp_path / "still", *options).returncode == 0
    assert make_scene("--output", tmp_path / "moved", "--drift", "20,4", *options).returncode == 0
    same = [filecmp.cmp(str(tmp_path / "still" / name), str(tmp_path / "moved" / name), shallow=False)
            for name in ("truth.png", "depth.png", "stack/000.png", "stack/001.png", "stack/002.png")]
    assert same == [True, True, False, True, False]
    made = json.loads((tmp_path / "moved" / "scene.json").read_text())
    assert (made["drift_mm"], made["drift_seed"]) == (20, 4)


def test_vignetting_darkens_the_corners():
    camera = scene_of(flat([0, 0, 0], 1000.0)).rig.color
    gain = lens.vignette(camera, 0.3, 50.0, 1000.0, 1000.0)
    assert gain.shape == (80, 120) and gain[40, 60] == 1 and gain[0, 0] == pytest.approx(0.7)
    near = lens.vignette(camera, 0.3, 50.0, 500.0, 1000.0)
    assert near[0, 0] == pytest.approx(1 - 0.3 * ((50000 / 950) / (25000 / 450)) ** 2), "the sensor is farther away"
    frame, = lens.render_bracket(scene_of(flat([0.5] * 3, 1000.0)), OPTICS, [1000.0], lens.Disturbance(vignetting=0.3))
    assert imaging.srgb_to_linear(frame)[..., 0] == pytest.approx(0.5 * gain, abs=0.005)


@pytest.mark.parametrize("name", ["planes", "motorcycle"])
def test_tiles_have_no_seams(name, monkeypatch):
    preset, tiles = SCENES[name], []
    for size in (lens.TILE_PX, 48):
        monkeypatch.setattr(lens, "TILE_PX", size)
        monkeypatch.setattr(surfaces, "TILE_PX", size)
        scene = preset.build((160, 120), preset.optics, 0)
        tiles.append((scene.truth(), scene.truth_depth(), lens.render_frame(scene, Optics(50.0, 0.7, 0.03), 3500.0)))
    for whole, tiled in zip(*tiles):
        assert np.allclose(whole, tiled, atol=1e-4)


def test_large_blur_circles_are_rounded_to_less_than_one_percent():
    diameter = np.linspace(1.2, 300, 5000)
    rounded = lens.blur_levels(diameter) * lens.LEVEL_STEP_PX
    assert (np.abs(rounded - diameter) <= np.maximum(lens.LEVEL_STEP_PX / 2, 0.008 * diameter)).all()
    assert len(np.unique(rounded[diameter > 100])) < 150


def test_depth_camera_sees_the_same_in_a_large_picture():
    """The canvas of a large picture ends where the lens does; the depth camera looks at one of its own."""
    preset = SCENES["planes"]
    large, small = (preset.build(size, preset.optics, 0) for size in ((1920, 480), (640, 160)))
    assert small.seen_by_depth is None and large.seen_by_depth.rig.color.width == 960
    assert large.margin[0] <= 120 < large.seen_by_depth.margin[0]
    one, other = (kinect.warp_to_depth_camera(scene) for scene in (large, small))
    assert (np.abs(one - other) < 0.01 * other).mean() > 0.98


def test_grain_adds_texture_in_patches():
    scenes = [scene_of(flat([0.4] * 3, 2000.0, size=(500, 800))) for _ in range(2)]
    for scene in scenes:
        add_grain(scene, 0.2, 1)
    truth = scenes[0].truth()
    assert np.array_equal(truth, scenes[1].truth())
    strength = cv2.blur(np.abs(cv2.Laplacian(truth[..., 0], cv2.CV_32F)), (25, 25))
    assert truth.mean() == pytest.approx(0.4, abs=0.02) and 0.01 < truth.std() < 0.08
    assert strength.min() < 0.02 * strength.max(), "somewhere smooth"


def test_lamps_are_clipped_by_the_picture_only():
    """A lamp's blur disc is brighter than a white surface would give: what saturates is the picture."""
    picture = np.zeros((80, 120, 3))
    picture[40, 60] = 50
    scene = scene_of(flat(picture, 1000.0))
    assert scene.truth().max() == 1
    expected = 50 * 4 / (np.pi * lens.blur_circle_px(OPTICS, 800.0, 1000.0, 2000.0) ** 2)
    assert lens.render_frame(scene, OPTICS, 2000.0)[40, 60, 0] == pytest.approx(expected, rel=0.05)


def test_noise_has_the_given_deviation():
    frame = lens.expose(np.full((200, 200, 3), 0.2, np.float32), np.random.default_rng(0), noise=4.0)
    assert frame.std() == pytest.approx(4, abs=0.1)
    code = np.arange(256, dtype=np.uint8)
    assert np.array_equal(lens.expose(imaging.srgb_to_linear(code)), code)


# --- depth camera -----------------------------------------------------------------------------------------------------

def test_wall_is_measured_in_disparity_steps():
    model = kinect.KinectModel()
    for z in (1000.0, 3000.0):
        step = z * z / (model.focal_px * model.baseline_mm) * model.disparity_step_px
        depth = kinect.measure(np.full((120, 160), z), 580.0, np.random.default_rng(0))
        seen = depth[:, :-model.dead_columns]
        lit = seen[seen > 0].astype(float)
        assert len(lit) > 0.7 * seen.size and (depth[:, -model.dead_columns:] == 0).all()
        assert np.abs(lit - z).max() <= 2 * step and np.abs(lit - z).mean() < step / 2 + 1
        assert len(np.unique(lit)) <= 4


def test_shadow_lies_to_the_left_of_a_near_object():
    depth = np.full((60, 320), 2000.0)
    depth[20:40, 150:200] = 1000.0
    shadow = kinect.projector_shadow(depth, 580.0, 75.0)
    width = 580 * 75 * (1 / 1000 - 1 / 2000)  # 21.75 px
    assert shadow[30, 150 - int(width) + 1:149].all() and not shadow[30, 100:150 - int(width) - 2].any()
    assert not shadow[30, 151:280].any() and not shadow[10, 60:280].any()


def test_a_thin_object_casts_a_thin_shadow():
    depth = np.full((1, 320), 2000.0)
    depth[0, 200:204] = 1000.0
    shadow = np.flatnonzero(kinect.projector_shadow(depth, 580.0, 75.0)[0, 60:280]) + 60
    assert 3 <= len(shadow) <= 5 and 177 <= shadow.min() and shadow.max() <= 183


def test_range_limits():
    depth = np.full((60, 160), 7000.0)
    depth[:, 80:] = 300.0
    assert not kinect.measure(depth, 580.0, np.random.default_rng(0)).any()


def test_holes_are_filled_from_the_farther_side():
    depth = np.array([[0, 5, 0, 0, 9, 0], [0, 0, 0, 0, 0, 0]])
    assert np.array_equal(imaging.fill_from_farther(depth), [[5, 5, 9, 9, 9, 9], [0, 0, 0, 0, 0, 0]])


@pytest.mark.parametrize("name, size", [("planes", (320, 240)), ("motorcycle", (370, 250))])
def test_registered_depth_agrees_with_the_truth(name, size):
    scene = SCENES[name].build(size, SCENES[name].optics, 0)
    depth, truth, rig = kinect.simulate(scene), scene.truth_depth(), scene.rig
    assert depth.shape == (480, 640) and 0.8 < (depth > 0).mean() < 0.99
    v, u = np.nonzero(depth)
    z = depth[v, u] / 1000.0
    points = np.linalg.solve(rig.depth.K, np.stack([u, v, np.ones(len(z))])) * z
    x, y, z = rig.R @ points + rig.t[:, None]
    u, v = np.floor((rig.color.K @ [x / z, y / z, np.ones(len(z))])[:2] + 0.5).astype(int)
    inside = (u >= 0) & (v >= 0) & (u < size[0]) & (v < size[1])
    error = np.abs(1000 * z[inside] / truth[v[inside], u[inside]] - 1)
    assert inside.sum() > 50000
    assert np.median(error) < 0.01 and (error < 0.03).mean() > 0.85


# --- built scenes and their surfaces ----------------------------------------------------------------------------------

def white(a, _):
    return np.ones(a.shape + (3,), np.float32), np.ones(a.shape, bool)


@lru_cache(maxsize=None)
def built(name):
    """A scene that is only looked at."""
    return SCENES[name].build((160, 120), SCENES[name].optics, 0)


@pytest.mark.parametrize("name", sorted(SCENES))
def test_scene_is_seen_by_both_cameras(name):
    scene = built(name)
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
    scene = built(name)
    nearest = np.full(scene.layers[0].depth.shape, np.inf)
    for layer in scene.layers:
        shown = layer.alpha >= 0.5
        behind = np.isfinite(nearest) & shown
        # A thing stands on the ground, one pixel deep in it where its foot is antialiased.
        assert (layer.depth[behind] <= 1.05 * nearest[behind]).all()
        nearest[shown] = layer.depth[shown]


def test_clutter_depends_on_the_seed_only():
    first, again, other = (SCENES["clutter"].build((64, 48), BRIGHT_LENS, seed).truth() for seed in (1, 1, 2))
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
    scene = measured(image, depth, None, (160, 120), BRIGHT_LENS, 0)
    assert isinstance(scene, LayeredScene) and np.array_equal(lens.expose(scene.truth()), image)
    assert (scene.truth_depth()[depth > 0] == depth[depth > 0]).all() and scene.truth_depth().min() == 1000
    assert scene.rig.color.K[0, 0] == pytest.approx(160 * 50 / 36)
    assert measured(image, depth, 300.0, (80, 60), BRIGHT_LENS, 0).rig.color.K[0, 0] == pytest.approx(150)


def test_flat_depth_is_one_layer():
    scene = measured(skimage.data.chelsea()[:48, :64], np.full((48, 64), 1500, np.uint16), None, (64, 48), BRIGHT_LENS, 0)
    assert len(scene.layers) == 1


def make_picture_scene(tmp_path, *arguments, depth=None, scene="picture"):
    image = skimage.data.coffee()[:96, :128]
    cv2.imwrite(str(tmp_path / "p.png"), image[..., ::-1])
    if depth is None:
        depth = np.uint16(np.linspace(3000, 1000, 96))[:, None].repeat(128, axis=1)
    cv2.imwrite(str(tmp_path / "z.png"), depth)
    files = ("--picture", tmp_path / "p.png", "--depth", tmp_path / "z.png")
    return image, make_scene("--scene", scene, "--frames", 2, "--output", tmp_path / "scene",
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
    expect_refusal(make_picture_scene(tmp_path, *arguments, **options)[1], "make_scene", reason)
    assert not (tmp_path / "scene").exists()


# --- scenes and the program -------------------------------------------------------------------------------------------

def test_motorcycle_truth_is_the_photograph():
    scene = SCENES["motorcycle"].build((741, 500), SCENES["motorcycle"].optics, 0)
    left, _, disparity = skimage.data.stereo_motorcycle()
    assert np.array_equal(lens.expose(scene.truth()), left)
    known, depth = np.isfinite(disparity), scene.truth_depth()
    assert np.allclose(depth[known], 994.978 * 193.001 / (disparity[known] + 31.086), rtol=1e-5)
    assert np.isfinite(depth).all() and depth.min() > 2000 and depth.max() < 5100
    assert not any(layer.weight[layer.alpha == 0].any() for layer in scene.layers)


def test_program_writes_a_complete_scene_and_repeats_itself(tmp_path):
    options = ["--frames", 3, "--size", "160x120", "--noise", 2, "--exposure-jitter", 0.1, "--breathing", 1,
               "--optics", "50,1.8,0.03"]
    for name, seed, make in (("a", 5, partial(run_script, "make_scene")), ("b", 5, make_scene), ("c", 6, make_scene)):
        result = make("--scene", "planes", "--output", tmp_path / name, "--seed", seed, *options)
        assert (result.returncode, result.stderr) == (0, "")
    assert sorted(os.listdir(tmp_path)) == ["a", "b", "c"]
    files = sorted(str(path.relative_to(tmp_path / "a")) for path in (tmp_path / "a").rglob("*") if path.is_file())
    files.remove(".all_in_focus")  # names the run
    assert files == ["depth.png", "focus.yaml", "rig/color.yaml", "rig/depth.yaml", "rig/extrinsics.yaml",
                     "rig/optics.yaml", "scene.json", "stack/000.png", "stack/001.png", "stack/002.png", "truth.png",
                     "truth_depth.png"]
    same = filecmp.cmpfiles(str(tmp_path / "a"), str(tmp_path / "b"), files, shallow=False)
    assert same == (files, [], [])
    assert "stack/001.png" in filecmp.cmpfiles(str(tmp_path / "a"), str(tmp_path / "c"), files, shallow=False)[1]

    images = {name: cv2.imread(str(tmp_path / "a" / name), cv2.IMREAD_UNCHANGED)
              for name in files if name.endswith(".png")}
    assert images["depth.png"].shape == (480, 640) and images["depth.png"].dtype == np.uint16
    assert images["truth_depth.png"].shape == (120, 160) and images["truth_depth.png"].dtype == np.uint16
    assert images["truth_depth.png"].min() > 0
    assert all(images[name].shape == (120, 160, 3) and images[name].dtype == np.uint8
               for name in ("truth.png", "stack/000.png"))
    focus = yaml.safe_load((tmp_path / "a" / "focus.yaml").read_text())["frames"]
    assert [frame["file"] for frame in focus] == ["000.png", "001.png", "002.png"]
    assert focus[0]["focus_mm"] == pytest.approx(images["truth_depth.png"].min(), abs=1)
    assert load_rig(str(tmp_path / "a" / "rig")).optics == Optics(50.0, 1.8, 0.03)

    before = set(os.listdir(tmp_path / "a"))
    assert make_scene("--scene", "planes", "--output", tmp_path / "a", "--frames", 2, "--size", "64x48").returncode == 0
    assert set(os.listdir(tmp_path / "a")) == before
    assert len(os.listdir(tmp_path / "a" / "stack")) == 2


def test_linear_codes_are_in_proportion_to_light(tmp_path):
    options = ["--scene", "planes", "--frames", 2, "--size", "64x48"]
    assert make_scene("--output", tmp_path / "srgb", *options).returncode == 0
    assert make_scene("--output", tmp_path / "linear", "--linear", *options).returncode == 0
    for name in ("truth.png", "stack/000.png"):
        srgb, linear = (cv2.imread(str(tmp_path / curve / name)) for curve in ("srgb", "linear"))
        assert np.abs(255 * imaging.srgb_to_linear(srgb) - linear).max() < 2


def test_enlarged_scene_is_the_small_one(tmp_path):
    options = ["--scene", "planes", "--frames", 2, "--size", "64x48", "--noise", 2, "--sag", "1,1,1"]
    assert make_scene("--output", tmp_path / "small", *options).returncode == 0
    assert make_scene("--output", tmp_path / "large", "--enlarge", 3, *options).returncode == 0
    for name in ("truth.png", "truth_depth.png", "stack/000.png", "stack/001.png"):
        small, large = (cv2.imread(str(tmp_path / size / name), cv2.IMREAD_UNCHANGED) for size in ("small", "large"))
        assert large.shape[:2] == (144, 192) and np.array_equal(large[1::3, 1::3], small)
        assert np.array_equal(large, small.repeat(3, axis=0).repeat(3, axis=1)) == (name == "truth_depth.png")
    for name in ("depth.png", "focus.yaml", "rig/depth.yaml", "rig/optics.yaml"):
        assert filecmp.cmp(str(tmp_path / "small" / name), str(tmp_path / "large" / name), shallow=False)
    small, large = (load_rig(str(tmp_path / size / "rig")).color for size in ("small", "large"))
    assert (large.width, large.height) == (192, 144)
    for point in ([0, 0, 1], [0.1, -0.2, 1]):
        assert (large.K @ point)[:2] == pytest.approx(3 * (small.K @ point)[:2] + 1), "the middle of the same pixel"
    truths = [Truth.load(str(tmp_path / size)) for size in ("small", "large")]
    assert np.array_equal(truths[0].image, truths[1].image) and np.array_equal(truths[0].edges, truths[1].edges)
    fused = cv2.imread(str(tmp_path / "large" / "stack" / "000.png"))
    assert np.array_equal(truths[1].compared(fused), cv2.imread(str(tmp_path / "small" / "stack" / "000.png")))


@pytest.mark.parametrize("arguments, reason", [
    (["--scene", "moon"], "invalid choice: 'moon'"),
    (["--frames", "0"], "--frames"),
    (["--frames", "2.5"], "--frames"),
    (["--optics", "50,1.8"], "expected three positive numbers f,F,coc"),
    (["--optics", "50,-1,0.03"], "expected three positive numbers f,F,coc"),
    (["--optics", "900,4,0.03", "--size", "64x48"], "too long for a scene that begins at"),
    (["--size", "640"], "expected WxH"),
    (["--noise", "nan"], "--noise"),
    (["--exposure-jitter", "-1"], "--exposure-jitter"),
    (["--vignetting", "1"], "--vignetting"),
    (["--sag", "1,2"], "expected ROLL,X,Y"),
    (["--sag", "9,0,0"], "expected a number from -5 to 5"),
    (["--drift", "-1"], "expected a number from 0 to 100"),
    (["--drift", "2,x"], "--drift"),
    (["--drift", "2", "--grain", "0.1"], "--grain lies on the picture"),
    (["--scene", "motorcycle", "--drift", "2"], "built of surfaces"),
    (["--enlarge", "4"], "expected an odd number"),
])
def test_bad_arguments(tmp_path, arguments, reason):
    expect_refusal(make_scene("--scene", "planes", "--output", tmp_path / "scene", *arguments), "make_scene", reason)
    assert os.listdir(tmp_path) == []


def test_never_overwrites_what_it_did_not_make(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    expect_refusal(make_scene("--scene", "planes", "--output", tmp_path), "make_scene", "was not written by make_scene")
    assert os.listdir(tmp_path) == ["notes.txt"]
