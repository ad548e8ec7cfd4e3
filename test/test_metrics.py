# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The fusion metrics against published images, against their definitions, and the program that prints them."""
import json

import cv2
import naive_metrics
import numpy as np
import pytest
from file_helpers import call, cut, run_script
from skimage.data import brick, gravel
from test_evaluate_scores import PUBLISHED
from test_recorded_sample import PAIRS, needs_pairs
from tool_helpers import expect_refusal

from all_in_focus_lab import metrics
from all_in_focus_lab.metrics import METRICS, evaluate
from all_in_focus_lab.metrics import images as shared
from all_in_focus_lab.metrics.images import remembered, stretched
from all_in_focus_lab.metrics.phase import phase_congruency
from all_in_focus_lab.metrics.truth import psnr, ssim

NAIVE = {"Q_MI": naive_metrics.q_mi, "Q_NCIE": naive_metrics.q_ncie, "Q_G": naive_metrics.q_g,
         "Q_P": naive_metrics.q_p, "Q_Y": naive_metrics.q_y, "Q_CB": naive_metrics.q_cb}


# --- published images -------------------------------------------------------------------------------------------------

def published(scene, method):
    """An image of the pairs; sources alone and the recomposed label map are made here."""
    a, b = (cv2.imread(str(PAIRS / scene / name)) for name in ("source_a.jpg", "source_b.jpg"))
    if method.startswith("source_"):
        return {"source_A_only": a, "source_B_only": b}[method]
    if method == "recovered_label_recomposed":
        return np.where(cv2.imread(str(PAIRS / scene / "label_front.png")) == 255, a, b)
    return cv2.imread(str(PAIRS / scene / f"fused_{method}.png"))


@needs_pairs
@pytest.mark.parametrize("scene", ["scene1", "scene2"])
def test_reference_values(scene):
    """Of the images that test_evaluate_scores.py does not measure."""
    sources = [published(scene, "source_A_only"), published(scene, "source_B_only")]
    expected = json.loads((PAIRS / scene / "metrics.json").read_text())
    others = set(expected) - set(PUBLISHED.values())
    assert (len(expected), len(others)) == (11, 4)
    for method in others:
        assert evaluate(sources, published(scene, method)) == pytest.approx(expected[method], rel=0, abs=1e-9), method


@needs_pairs
def test_phase_congruency_of_a_photograph():
    maps = phase_congruency(metrics.to_gray(published("scene1", "source_A_only")))
    assert maps.mean(axis=(1, 2)) == pytest.approx([0.1559392589, 0.0747929040, 0.0328887468], abs=1e-10)


# --- definitions ------------------------------------------------------------------------------------------------------

def random_images(shape, seed):
    """Smooth random images with flat parts; the last one lies between the others."""
    random = np.random.default_rng(seed)
    images = [cv2.GaussianBlur(np.float32(random.integers(0, 256, shape)), (0, 0), 1) for _ in range(2)]
    images = [np.uint8(np.clip((image - 128) * 3 + 128, 0, 255)) for image in images]
    for image in images[:2]:
        image[2:12, 3:14] = 0     # both zero
        image[12:21, 14:24] = 77  # both constant
    images[0][5:16, -12:] = 200   # one of them constant
    weight = cv2.GaussianBlur(np.float32(random.random(shape)), (0, 0), 2) > 0.5
    return [*images, np.where(weight, images[0], images[1])]


@pytest.mark.parametrize("name", sorted(METRICS))
@pytest.mark.parametrize("shape", [(33, 41), (32, 40), (41, 30)])
def test_definition(name, shape):
    for seed in range(2):
        a, b, fused = random_images(shape, seed)
        assert METRICS[name]([a, b], fused) == pytest.approx(NAIVE[name](a, b, fused), rel=0, abs=1e-9)


def test_gray_is_rounded_half_up():
    colours = np.random.default_rng(0).integers(0, 256, (50, 40, 3), np.uint8)
    exact = sum(int(1e6 * weight + 0.5) * colours[..., channel].astype(int)
                for channel, weight in enumerate((0.114021, 0.587043, 0.298936)))
    assert np.array_equal(metrics.to_gray(colours), (exact + 500000) // 1000000)
    gray = np.arange(256, dtype=np.uint8)[None]
    assert metrics.to_gray(gray) is gray and np.array_equal(metrics.to_gray(np.dstack([gray] * 3)), gray)


def test_stretching_rounds_half_up():
    assert stretched(np.uint8([[10, 11, 12]])).tolist() == [[0, 128, 255]]
    assert stretched(np.full((2, 2), 7, np.uint8)).tolist() == [[7, 7], [7, 7]]


# --- what must not change, what must ----------------------------------------------------------------------------------

def test_identical_images_score_best():
    image = random_images((35, 43), 3)[0]
    values = evaluate([image, image], image)
    best = 1 / (1 + np.exp(-5)) ** 2  # of Q_G
    assert [values[name] for name in ("Q_MI", "Q_Y", "Q_CB", "Q_G")] == pytest.approx([2, 1, 1, best])
    assert 0.5 < values["Q_NCIE"] < 1 and 0.9 < values["Q_P"] < 1  # only the sources' maps are masked


def test_order_of_sources_does_not_matter():
    a, b, fused = random_images((35, 43), 4)
    # Q_G: the published values know the order in their 9th digit.
    assert evaluate([a, b], fused) == pytest.approx(evaluate([b, a], fused), abs=1e-7)


def test_information_is_blind_to_place_and_to_contrast():
    a, b, fused = (image // 2 for image in random_images((35, 43), 5))
    order = np.random.default_rng(0).permutation(a.size)
    for name in ("Q_MI", "Q_NCIE"):
        value = METRICS[name]([a, b], fused)
        moved = [image.ravel()[order].reshape(a.shape) for image in (a, b, fused)]
        assert METRICS[name](moved[:2], moved[2]) == pytest.approx(value, abs=1e-12)
        assert METRICS[name]([a + np.uint8(9), b], fused + np.uint8(50)) == pytest.approx(value, abs=1e-12)


@pytest.mark.parametrize("name", ["Q_G", "Q_Y"])
def test_half_a_turn_changes_nothing(name):
    a, b, fused = (image.astype(np.uint8) for image in random_images((35, 43), 6))
    value = METRICS[name]([a, b], fused)
    assert METRICS[name]([a[::-1, ::-1], b[::-1, ::-1]], fused[::-1, ::-1]) == pytest.approx(value, abs=1e-9)


def test_blur_costs():
    texture = np.ascontiguousarray(gravel()[:101, :131])
    a, b = texture.copy(), texture.copy()
    a[:, 65:], b[:, :65] = (cv2.GaussianBlur(texture, (0, 0), 3)[:, part] for part in (slice(65, None), slice(65)))
    good, blurred = evaluate([a, b], texture), evaluate([a, b], cv2.GaussianBlur(texture, (0, 0), 1.5))
    assert all(good[name] > blurred[name] for name in METRICS)


def test_more_sources():
    a, b, fused = random_images((35, 43), 7)
    c = np.ascontiguousarray(brick()[:35, :43])
    pairs = [evaluate(pair, fused) for pair in ([a, b], [a, c], [b, c])]
    values = evaluate([a, b, c], fused)
    assert values["Q_MI"] == pytest.approx(np.mean([pair["Q_MI"] for pair in pairs]))
    assert all(0 < value < 2 for value in values.values())
    assert evaluate([c, b, a], fused) == pytest.approx(values, abs=1e-6)

    black = evaluate([a, b, np.zeros_like(a)], fused)  # has no features, no gradient
    assert [black[name] for name in ("Q_P", "Q_G")] == pytest.approx([pairs[0][name] for name in ("Q_P", "Q_G")],
                                                                     abs=1e-4)
    assert METRICS["Q_P"]([a, b, b], fused) == pytest.approx(pairs[0]["Q_P"])


def test_flat_images():
    flat = np.full((20, 21), 90, np.uint8)
    texture = np.ascontiguousarray(gravel()[:20, :21])
    with np.errstate(all="raise"):
        values = evaluate([flat, flat], flat)
        assert values["Q_MI"] == 0 and values["Q_Y"] == 1 and np.isnan(values["Q_P"])
        assert np.isnan(evaluate([flat * 0, flat * 0], flat)["Q_Y"])
        assert all(np.isfinite(value) for value in evaluate([flat, texture], flat).values())


# --- errors and the program -------------------------------------------------------------------------------------------

@pytest.mark.parametrize("sources, fused, reason", [
    ([np.zeros((9, 9), np.uint8)], np.zeros((9, 9), np.uint8), "at least two sources"),
    ([np.zeros((9, 9), np.uint8), np.zeros((9, 8), np.uint8)], np.zeros((9, 9), np.uint8), "8x9 and 9x9"),
    ([np.zeros((9, 6), np.uint8)] * 2, np.zeros((9, 6), np.uint8), "too small"),
    ([np.zeros((9, 9))] * 2, np.zeros((9, 9)), "expected an 8-bit image"),
    ([np.zeros((9, 9, 4), np.uint8)] * 2, np.zeros((9, 9), np.uint8), "expected an 8-bit image"),
])
def test_bad_images(sources, fused, reason):
    with pytest.raises(ValueError, match=reason):
        evaluate(sources, fused)


@pytest.fixture
def files(tmp_path):
    """Options of the program."""
    options = []
    for name, image in zip(("a", "b", "fused"), random_images((33, 41), 8)):
        path = str(tmp_path / (name + ".png"))
        assert cv2.imwrite(path, cv2.applyColorMap(image, cv2.COLORMAP_JET))
        options += ["--" + name, path]
    return options


def evaluate_fusion(*arguments):
    return call("evaluate_fusion", *arguments)


def test_program(files):
    a, b, fused = (cv2.imread(path) for path in files[1::2])
    expected = evaluate([a, b], fused)
    done = run_script("evaluate_fusion", *files)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [f"{name:<7} {value:8.4f}" for name, value in expected.items()]
    done = evaluate_fusion(*files, "--json", "--reference", files[1])
    assert json.loads(done.stdout) == {**expected, "PSNR": psnr(fused, a), "SSIM": ssim(fused, a)}
    assert json.loads(evaluate_fusion(*files, "--json", "--reference", files[5]).stdout)["PSNR"] is None


def test_program_refuses(tmp_path, files):
    small = str(tmp_path / "small.png")
    assert cv2.imwrite(small, np.zeros((9, 12, 3), np.uint8))
    expect_refusal(evaluate_fusion(), "evaluate_fusion", "--a")
    expect_refusal(evaluate_fusion(*files, "spare"), "evaluate_fusion", "spare")
    expect_refusal(evaluate_fusion(*files[:4], "--fused", "nowhere.png"), "evaluate_fusion", "nowhere.png")
    expect_refusal(evaluate_fusion(*files[:4], "--fused", small), "evaluate_fusion", "12x9 pixels, but")
    expect_refusal(evaluate_fusion(*files, "--reference", small), "evaluate_fusion", "small.png")
    expect_refusal(evaluate_fusion("--a", small, "--b", small, "--fused", small, "--reference", small),
                   "evaluate_fusion", "win_size")
    cut(files[5])
    expect_refusal(evaluate_fusion(*files), "evaluate_fusion", "truncated or damaged")


# --- what is remembered of sources ------------------------------------------------------------------------------------

def test_remembered_sources_change_no_value():
    """Other fused images, the sources in another order, one pixel changed: each value is that of a first call."""
    one, other, fused = (np.uint8(np.clip(image[:48, :64] + 10.0 * number, 0, 255))
                         for number, image in enumerate((brick(), gravel(), brick()[100:])))
    changed = one.copy()
    changed[20, 30] ^= 64
    calls = [([one, other], fused), ([one, other], other), ([other, one], fused), ([changed, other], fused)] * 2
    again = [{name: metric(*given) for name, metric in METRICS.items()} for given in calls]
    for given, values in zip(calls, again):
        shared._remembered.clear()
        assert {name: metric(*given) for name, metric in METRICS.items()} == values
    assert again[0] != again[3]


def test_memory_of_sources_is_bounded(monkeypatch):
    calls = []
    count = remembered(lambda image: calls.append(1) or (np.float64(image), [image]))
    images = [np.full((10, 10), value, np.uint8) for value in range(5)]
    monkeypatch.setattr(shared, "MEMORY_BYTES", 2000)
    shared._remembered.clear()
    for image in (images[0], images[0], images[1], images[0], images[2], images[0], images[1]):
        assert np.array_equal(count(image)[0], image)
    assert len(calls) == 4, "900 bytes each: the two latest are kept"
    monkeypatch.setattr(shared, "MEMORY_BYTES", 500)
    assert count(images[3])[1][0] is images[3] and not shared._remembered
