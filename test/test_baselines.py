# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The fusion methods that others published, as the benchmark runs them."""
import json
import shutil

import cv2
import numpy as np
import pytest
import pywt
import skimage.data
from test_evaluate_scores import METHODS as PAPER_METHODS
from test_evaluate_scores import T3
from test_recorded_sample import PAIRS, needs_pairs

from all_in_focus_lab import metrics
from all_in_focus_lab.baselines import (BASELINES, contourlet, convolutional, dense_sift, guided_filtering, matting,
                                        pulse_coupled, wavelet)
from all_in_focus_lab.baselines.alignment import align
from all_in_focus_lab.metrics import phase
from all_in_focus_lab.metrics.truth import psnr

needs_enfuse = pytest.mark.skipif(shutil.which("enfuse") is None, reason="enfuse is not installed")
METHODS = [pytest.param(name, marks=needs_enfuse if name == "enfuse" else ()) for name in sorted(BASELINES)]
WITHOUT_WEIGHTS = {"dwt", "enfuse", "nsct", "nsct-pcnn"}
# dB that a method must reach on half_sharp(); those in a transform mix what is coarser than their coarsest level.
SHARP_HALVES = {"enfuse": 30, "dwt": 33, "nsct": 33, "nsct-pcnn": 33}


def sharp_picture(height=240, width=320):
    """Texture everywhere."""
    texture = skimage.data.gravel()[:height, :width]
    return np.ascontiguousarray(np.dstack([texture, texture // 2 + 60, skimage.data.brick()[:height, :width]]))


def half_sharp(truth):
    """Two pictures, sharp in the left and in the right half."""
    blurred, middle = cv2.GaussianBlur(truth, (0, 0), 3), truth.shape[1] // 2
    return [np.hstack([truth[:, :middle], blurred[:, middle:]]), np.hstack([blurred[:, :middle], truth[:, middle:]])]


def check(images, fused, weights, name):
    """What every method promises."""
    assert fused.shape == images[0].shape and fused.dtype == np.uint8
    assert (weights is None) == (name in WITHOUT_WEIGHTS)
    if weights is not None:
        assert weights.dtype == np.float32 and weights.shape == (len(images),) + fused.shape[:2]
        assert weights.min() >= 0 and np.allclose(weights.sum(axis=0), 1, atol=1e-5)


@pytest.mark.parametrize("name", METHODS)
def test_takes_the_sharp_halves(name):
    truth = sharp_picture(120)
    images = half_sharp(truth)
    fused, weights = BASELINES[name](images)
    check(images, fused, weights, name)
    away = np.ones(truth.shape[:2], bool)
    away[:, 140:180] = False  # the seam of the two sources
    assert psnr(fused, truth, away) > SHARP_HALVES.get(name, 40) > 4 + psnr(images[0], truth, away)
    if weights is not None:
        index = weights.argmax(axis=0)
        assert (index[:, :150] == 0).all() and (index[:, 170:] == 1).all()


@pytest.mark.parametrize("name", METHODS)
def test_three_images(name):
    """One is sharp nowhere, the last of odd size in both directions."""
    truth = sharp_picture(81, 121)
    blurred = [cv2.GaussianBlur(truth, (0, 0), sigma) for sigma in (3, 4, 5)]
    images = [blurred[0], np.vstack([truth[:41], blurred[1][41:]]), np.vstack([blurred[2][:41], truth[41:]])]
    fused, weights = BASELINES[name](images)
    check(images, fused, weights, name)
    assert psnr(fused, truth) > 4 + max(psnr(image, truth) for image in images)


@pytest.mark.parametrize("name", METHODS)
def test_single_image_comes_out_as_it_is(name):
    picture = sharp_picture(81, 121)
    fused, weights = BASELINES[name]([picture])
    check([picture], fused, weights, name)
    assert psnr(fused, picture) > (45 if name == "enfuse" else 99)


@pytest.mark.parametrize("name", sorted(set(BASELINES) - {"enfuse"}))
def test_images_without_any_texture(name):
    flat = np.full((30, 40, 3), 120, np.uint8)
    fused, weights = BASELINES[name]([flat, flat, flat])
    assert np.array_equal(fused, flat)
    check([flat] * 3, fused, weights, name)


@pytest.mark.parametrize("name", sorted(set(BASELINES) - {"dsift", "enfuse"}))  # dsift refuses less than 8x8 pixels
@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (5, 2)])
def test_tiny_images(name, shape):
    images = [np.full(shape + (3,), value, np.uint8) for value in (100, 120)]
    check(images, *BASELINES[name](images), name)


# --- published results ------------------------------------------------------------------------------------------------

# Published image; does the method see gray images; dB to it and distance of the metrics that are reached.
PUBLISHED = {
    "dwt": ("dwt", True, 51, 0.004),          # equal but within 16 pixels of the border
    "gf": ("gf_diff", False, 62, 0.002),      # rounding of colours before they are made gray
    "gf-same": ("gf_same", False, 62, 0.002),
    "dsift": ("dsift", False, 43, 0.01),      # undecided pixels are not matched between the sources
    "im": ("im", False, 42, 0.0095),          # another thinning of the certain pixels, noise in areas of one colour
    "nsct": ("nsct", True, 60, 0.002),        # equal but where two energies are nearly the same
    "nsct-pcnn": ("pcnn", True, 37, 0.012),   # another pyramid, other borders
}


@pytest.fixture(scope="module")
def remembered():
    """Array of bytes -> phase congruency of the image: that of the sources takes two thirds of the time of Q_P."""
    return {}


@pytest.fixture
def pair(request, monkeypatch, remembered):
    """(scene, its two sources)."""
    def congruency(gray):
        key = gray.tobytes()
        if key not in remembered:
            remembered[key] = original(gray)
        return remembered[key]

    original = phase.phase_congruency
    monkeypatch.setattr(phase, "phase_congruency", congruency)
    scene = PAIRS / request.param
    return scene, [cv2.imread(str(scene / name)) for name in ("source_a.jpg", "source_b.jpg")]


both_pairs = pytest.mark.parametrize("pair", ["scene1", "scene2"], indirect=True)


@needs_pairs
@both_pairs
@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(PUBLISHED))
def test_published_result(name, pair):
    method, gray, decibels, distance = PUBLISHED[name]
    scene, sources = pair
    given = [np.dstack([metrics.to_gray(source)] * 3) for source in sources] if gray else sources
    fused = metrics.to_gray(BASELINES[name](given)[0])
    expected = metrics.to_gray(cv2.imread(str(scene / f"fused_{method}.png")))
    published = json.loads((scene / "metrics.json").read_text())[method]
    values = metrics.evaluate(sources, fused)
    print(f"{scene.name} {name}: {psnr(fused, expected):.2f} dB to the published image, metrics (published):",
          ", ".join(f"{key} {values[key]:.4f} ({published[key]:.4f})" for key in published))
    assert psnr(fused, expected) > decibels
    assert max(abs(values[key] - published[key]) for key in published) < distance
    if name == "dwt":
        assert (fused != expected)[16:-16, 16:-16].mean() < 1e-4


@needs_pairs
@both_pairs
def test_network_reaches_the_published_metrics(pair):
    """Its image is not published, and the network is another: its row of table T3."""
    scene, sources = pair
    column = PAPER_METHODS.index("DCNN")
    first = 0 if scene.name == "scene1" else len(metrics.METRICS)
    values = metrics.evaluate(sources, BASELINES["dcnn"](sources)[0])
    published = {name: line[column] for name, line in zip(metrics.METRICS, T3[first:])}
    print(f"{scene.name} dcnn: metrics (published):",
          ", ".join(f"{key} {values[key]:.4f} ({published[key]:.4f})" for key in published))
    assert max(abs(values[key] - published[key]) for key in published) < 0.01


# --- their parts ------------------------------------------------------------------------------------------------------

def test_missing_enfuse_is_said(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(RuntimeError, match="enfuse is not installed"):
        BASELINES["enfuse"]([sharp_picture()])


def test_guided_filter_follows_the_edges_of_its_guide():
    guide = np.zeros((60, 80))
    guide[:, 40:] = 1
    noisy = guide + np.random.default_rng(0).normal(0, 0.1, guide.shape)
    smooth = guided_filtering.guided_filter(guide, noisy, radius=7, eps=1e-3)
    assert np.abs(smooth - guide).max() < 0.06 and np.abs(smooth - guide).mean() < 0.02
    blurred = guided_filtering.guided_filter(np.zeros_like(guide), guide, radius=7, eps=1e-3)
    assert 0.4 < blurred[30, 40] < 0.6, "a flat guide keeps no edge"


def test_wavelets_and_directional_filters_reconstruct():
    image = np.random.default_rng(0).random((32, 48))
    bands, margin = wavelet.transform(image), wavelet.MARGIN
    assert len(bands) == wavelet.LEVELS
    assert np.allclose(pywt.iswt2(bands, wavelet.HAAR)[margin:margin + 32, margin:margin + 48], image)
    bands = list(pulse_coupled.filters((41, 64)))
    assert len(bands) == 1 + sum(2 ** count for count in pulse_coupled.DIRECTIONS)
    assert np.allclose(sum(analysis * synthesis for analysis, synthesis in bands), 1)


@pytest.mark.parametrize("shape", [(32, 32), (64, 160), (96, 64, 3)])
def test_contourlets_reconstruct(shape):
    image = np.random.default_rng(0).random(shape)
    coarsest, levels = contourlet.transform(image)
    assert [len(subbands) for subbands in levels] == [2 ** count for count in contourlet.DIRECTIONS]
    assert np.allclose(contourlet.inverse(coarsest, levels), image)
    for count in range(1, 7):
        subbands = contourlet.directions(image, count)
        assert sum(subband.size for subband in subbands) == image.size
        assert np.allclose(contourlet.undirected(subbands), image)


def test_contourlets_of_steep_edges_come_first():
    stripes = np.sin(np.mgrid[:64, :64][1] * np.pi / 2)
    for image, first in ((stripes, True), (stripes.T, False)):
        for count in range(1, 7):
            energy = [(subband ** 2).sum() for subband in contourlet.directions(image, count)]
            half = len(energy) // 2
            assert (sum(energy[:half]) > 50 * sum(energy[half:])) == first


def test_last_image_gives_the_border_of_each_subband():
    strong, weak = np.full((5, 7), 2.0), np.ones((5, 7))
    expected = np.ones((5, 7))
    expected[1:-1, 1:-1] = 0
    assert np.array_equal(contourlet.winner([strong, weak]), expected)


def test_directions_are_told_apart():
    y, x = 2 * np.pi * np.fft.fftfreq(64)[:, None], 2 * np.pi * np.fft.rfftfreq(64)[None]
    stripes = np.abs(np.fft.rfft2(np.sin(np.mgrid[:64, :64][1] * np.pi / 2 + np.mgrid[:64, :64][0] * np.pi / 8)))
    energy = [(stripes * analysis * synthesis).max() / stripes.max()
              for analysis, synthesis in pulse_coupled.directions(y, x, 2)]
    assert sorted(np.round(energy, 2)) == pytest.approx([0, 0, 0, 1], abs=0.05)


def test_blocks():
    wins = np.ones((13, 23), bool)  # of blocks of an image of 20 x 30 pixels
    assert dense_sift.unanimous(wins).shape == (20, 30) and dense_sift.unanimous(wins).all()
    wins[5, 9] = False
    lost = np.zeros((20, 30), bool)
    lost[5:13, 9:17] = True
    assert np.array_equal(dense_sift.unanimous(wins), ~lost)
    image = np.random.default_rng(0).random((20, 30))
    assert dense_sift.block_sums(image, 8)[3, 4] == pytest.approx(image[3:11, 4:12].sum())


@pytest.mark.parametrize("shape", [(1, 1), (5, 9), (15, 33), (31, 17), (101, 78)])
def test_score_of_a_pixel_is_that_of_the_patches_around_it(shape):
    one, other = np.random.default_rng(0).integers(0, 256, (2,) + shape).astype(np.float64)
    found = convolutional.focus_map(one, other)
    assert found.shape == shape and 0 <= found.min() <= found.max() <= 1
    margin, steps = convolutional.PATCH, range(0, convolutional.PATCH, convolutional.STEP)
    padded = [np.float32(np.pad(gray, margin, mode="symmetric")) / 255 for gray in (one, other)]
    for y, x in ((0, 0), (shape[0] // 2, shape[1] // 3), (shape[0] - 1, shape[1] - 1)):
        corners = [(margin + y // 2 * 2 - dy, margin + x // 2 * 2 - dx) for dy in steps for dx in steps]
        scores = [convolutional.patch_scores(*(gray[j:j + margin, i:i + margin] for gray in padded))
                  for j, i in corners]
        assert np.mean(scores) == pytest.approx(found[y, x], abs=1e-5)


def test_network_leaves_no_small_regions():
    one, other = np.float64(half_sharp(sharp_picture()[..., 0]))
    one[20:28, 300:308], other[20:28, 300:308] = other[20:28, 300:308], one[20:28, 300:308].copy()
    one[200:220, 40:60], other[200:220, 40:60] = other[200:220, 40:60], one[200:220, 40:60].copy()
    assert (convolutional.focus_map(one, other)[200:220, 40:60] < 0.5).any()
    first = convolutional.decision(one, other)
    assert first[:, :150].all() and not first[:, 170:].any()


def test_matting_follows_colours():
    image = np.zeros((60, 80, 3), np.uint8)
    image[:, 50:] = (200, 80, 30)
    front, back = np.zeros((2, 60, 80), bool)
    back[20:30, 5:10], front[20:30, 70:75] = True, True
    share = matting.matte(image, front, back)
    assert share[:, :50].max() < 0.1 and share[:, 50:].min() > 0.9
    matrix = matting.laplacian(np.random.default_rng(0).random((30, 40, 3)))
    one, other = np.random.default_rng(1).random((2, 30 * 40))
    assert (matrix @ one) @ other == pytest.approx((matrix @ other) @ one)
    assert np.allclose(matrix @ np.ones(30 * 40), 0) and (matrix @ one) @ one > 0


def test_matting_solves_its_equations():
    """At the unknown pixels the Laplacian of the matte is 0, as a dense solver finds it."""
    image = np.random.default_rng(0).random((20, 24, 3))
    known = np.ones((20, 24), bool)
    known[5:12, 6:15] = False
    matte = matting.solved(image, np.float64(known), np.float64(known & (np.indices(known.shape)[1] > 10))).ravel()
    rows = matting.laplacian(image).toarray()[~known.ravel()]
    expected = np.linalg.solve(rows[:, ~known.ravel()], -rows[:, known.ravel()] @ matte[known.ravel()])
    assert np.abs(matte[~known.ravel()] - expected).max() < 1e-6


def test_enlarged_matte_follows_colours_and_may_leave_its_range():
    """A matte that is linear in the colours stays so, whatever the size of the image."""
    for shape in ((480, 640), (301, 517)):
        image = cv2.GaussianBlur(np.random.default_rng(0).random(shape + (3,)), (0, 0), 5)
        image = (image - image.min()) / (image.max() - image.min())
        matte = image @ (2, -1, 0.5)
        half = matting.halved(image)
        coefficients = matting.linear(half @ (2, -1, 0.5), half)
        assert coefficients.shape == half.shape[:2] + (4,)
        found = matting.doubled(coefficients, shape)
        found = found[..., 3] + (found[..., :3] * image).sum(axis=2)
        assert matte.max() > 1 and np.abs(found - matte).max() < 0.01
        assert np.allclose(matting.halved(np.float64(np.indices(shape))[1])[5, 5:9], (12, 14, 16, 18))


def test_two_shares_need_not_sum_to_one(monkeypatch):
    """As published: what the second image gets is limited, what the first one gets is not."""
    images = [np.full((2, 3, 3), value, np.uint8) for value in (209, 200)]
    for share, expected in ((-0.4, 116), (0.4, 204), (1.2, 251)):
        monkeypatch.setattr(matting, "matte", lambda *_: np.full((2, 3), share))
        fused, weights = matting.fuse(images)
        assert (fused == expected).all()
        check(images, fused, weights, "im")
        assert matting.fuse(images + images[:1])[0].max() <= 209


def test_neurons_fire_faster_when_excited_and_linked():
    stimulus = np.zeros((9, 30), np.float32)
    stimulus[4, 5] = stimulus[4, 24] = stimulus[3:6, 14:17] = 0.3
    stimulus[4, 24] = 3
    counts = pulse_coupled.firing_counts(stimulus, link_decay=0.06931, linking=0.2)  # links that last
    assert counts[0, 0] == 0 < counts[4, 5] < min(counts[4, 15], counts[4, 24])


def test_alignment_undoes_breathing():
    truth = cv2.GaussianBlur(sharp_picture(), (0, 0), 1)
    frames = [cv2.warpAffine(truth, cv2.getRotationMatrix2D((160, 120), 0, scale), (320, 240), flags=cv2.INTER_CUBIC)
              for scale in (1.03, 1.015, 1.0, 0.985)]
    aligned = align(frames)
    assert len(aligned) == 4 and np.array_equal(aligned[2], frames[2])
    inner = np.zeros(truth.shape[:2], bool)
    inner[12:-12, 12:-12] = True
    for before, after in zip(frames[:2] + frames[3:], aligned[:2] + aligned[3:]):
        assert psnr(after, truth, inner) > 34 > 28 > psnr(before, truth, inner)


def test_alignment_leaves_alone_what_it_cannot_align():
    frames = [np.full((60, 80, 3), value, np.uint8) for value in (20, 120, 220)]
    assert all(np.array_equal(before, after) for before, after in zip(frames, align(frames)))
