# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The fusion methods that others published, as the benchmark runs them."""
import shutil

import cv2
import numpy as np
import pytest
import skimage.data

from all_in_focus.baselines import BASELINES, guided_filtering
from all_in_focus.baselines.alignment import align
from all_in_focus.quality import psnr

needs_enfuse = pytest.mark.skipif(shutil.which("enfuse") is None, reason="enfuse is not installed")
METHODS = [pytest.param(name, marks=needs_enfuse if name == "enfuse" else ()) for name in sorted(BASELINES)]


def sharp_picture():
    """240 x 320, texture everywhere."""
    texture = skimage.data.gravel()[:240, :320]
    return np.ascontiguousarray(np.dstack([texture, texture // 2 + 60, skimage.data.brick()[:240, :320]]))


def half_sharp(truth, sigma=3):
    """Two pictures, sharp in the left and in the right half."""
    blurred, middle = cv2.GaussianBlur(truth, (0, 0), sigma), truth.shape[1] // 2
    return [np.hstack([truth[:, :middle], blurred[:, middle:]]), np.hstack([blurred[:, :middle], truth[:, middle:]])]


@pytest.mark.parametrize("name", METHODS)
def test_takes_the_sharp_halves(name):
    truth = sharp_picture()
    fused, index = BASELINES[name](half_sharp(truth))
    assert fused.shape == truth.shape and fused.dtype == np.uint8
    away = np.ones(truth.shape[:2], bool)
    away[:, 140:180] = False  # the seam of the two sources
    assert psnr(fused, truth, away) > (40 if name != "enfuse" else 30)
    if index is not None:
        assert index.dtype == np.uint16 and (index[:, :150] == 0).all() and (index[:, 170:] == 1).all()


@pytest.mark.parametrize("name", METHODS)
def test_single_image_comes_out_as_it_is(name):
    fused, index = BASELINES[name]([sharp_picture()])
    assert psnr(fused, sharp_picture()) > (45 if name == "enfuse" else 99)
    assert index is None or not index.any()


@pytest.mark.parametrize("name", ["gf", "laplacian"])
def test_images_without_any_texture(name):
    flat = np.full((60, 80, 3), 120, np.uint8)
    fused, index = BASELINES[name]([flat, flat, flat])
    assert np.array_equal(fused, flat) and not index.any()


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
