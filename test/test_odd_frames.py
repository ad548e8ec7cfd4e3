# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Brackets in which frames went wrong: fuse_stack names them, and no such frame is the reference."""
import cv2
import numpy as np
import pytest

from tool_helpers import fuse_stack, succeeded

COUNT, SIZE = 7, (120, 160)


def frame(k):
    random = np.random.default_rng(3)
    coarse = cv2.resize(random.uniform(60, 180, (8, 10, 3)), SIZE[::-1], interpolation=cv2.INTER_CUBIC)
    return cv2.GaussianBlur(coarse + random.uniform(0, 60, (*SIZE, 3)), (0, 0), 0.5 + 0.1 * abs(k - 3))


def write_stack(folder, odd, change):
    folder.mkdir()
    for k in range(COUNT):
        picture = change(frame(k)) if k in odd else frame(k)
        cv2.imwrite(str(folder / f"IMG_{k + 1:04d}.png"), np.clip(np.rint(picture), 0, 255).astype(np.uint8))
    return folder


@pytest.mark.parametrize("change, said", [(lambda it: 0 * it, "is much darker than the others"),
                                          (lambda it: 0.3 * it, "is much darker than the others"),
                                          (lambda it: 3 * it, "is much brighter than the others"),
                                          (lambda it: it[::-1], "shows something else than the others")])
def test_an_odd_middle_frame_is_named_and_left_out(tmp_path, change, said):
    stack = write_stack(tmp_path / "stack", [3], change)
    done = fuse_stack(stack, "--output", tmp_path / "fused.png")
    succeeded(done)
    assert f"frame 3 (IMG_0004.png) rejected: it {said}" in done.stderr
    assert "6 of 7 frames, reference IMG_0005.png" in done.stderr
    error = cv2.imread(str(tmp_path / "fused.png")) - frame(3)
    assert np.sqrt(np.mean(error ** 2)) < 4


def test_few_used_frames_are_told_first(tmp_path):
    stack = write_stack(tmp_path / "stack", [3], lambda it: it[::-1])
    done = fuse_stack(stack, "--output", tmp_path / "fused.png", "--reference", "3")
    succeeded(done)
    assert "fuse_stack: only 1 of 7 frames were used" in done.stderr
    assert "correlation 1.00" not in done.stderr
