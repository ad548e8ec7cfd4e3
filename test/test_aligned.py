# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""fuse_stack --save-aligned and --crop, on frames whose magnification changes with the focus."""
import cv2
import numpy as np
import pytest

from tool_helpers import expect_refusal, fuse_stack, read, read_report, run_tool, snapshot, succeeded, unchanged, write

SIZE = (320, 240)
SCALES = (0.97, 0.985, 1.0, 1.015, 1.03)
GAIN = 0.8  # of frame 3, in linear light


def scene():
    random = np.random.default_rng(3)
    fine, coarse = random.uniform(0, 255, (2, SIZE[1], SIZE[0], 3)).astype(np.float32)
    coarse = cv2.resize(coarse[:12, :16], SIZE, interpolation=cv2.INTER_CUBIC)
    return np.clip(0.4 * cv2.GaussianBlur(fine, (0, 0), 1) + 0.6 * coarse, 20, 200)


def magnified(picture, scale):
    middle = (SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2
    return cv2.warpAffine(picture, cv2.getRotationMatrix2D(middle, 0, scale), SIZE, flags=cv2.INTER_CUBIC,
                          borderMode=cv2.BORDER_REFLECT)


@pytest.fixture
def stack(tmp_path):
    folder = tmp_path / "stack"
    folder.mkdir()
    for index, scale in enumerate(SCALES):
        frame = magnified(scene(), scale)
        if index == 3:
            frame = 255 * (frame / 255 * GAIN ** (1 / 2.2))
        write(folder / f"IMG_{index}.JPG.png" if index == 1 else folder / f"IMG_{index}.png", np.rint(frame).astype(np.uint8))
    return folder


def test_frames_as_they_were_fused(stack, tmp_path):
    done = succeeded(fuse_stack(stack, "--output", tmp_path / "o.png", "--save-aligned", tmp_path / "aligned"))
    assert "5 of 5 frames" in done.stderr
    names = sorted(path.name for path in (tmp_path / "aligned").iterdir())
    assert names == ["IMG_0.png", "IMG_1.JPG.png", "IMG_2.png", "IMG_3.png", "IMG_4.png"]
    inside = (slice(12, -12), slice(12, -12))
    for name, scale in zip(names, SCALES):
        aligned = read(tmp_path / "aligned" / name)
        assert cv2.PSNR(aligned[inside][..., :3], np.rint(scene()).astype(np.uint8)[inside]) > 32, name
        assert (aligned.shape[2] == 4) == (scale > 1)  # it shows less than the reference, or more
        if scale > 1:
            seen = aligned[..., 3] > 0
            margin = (1 - 1 / scale) / 2
            assert np.isclose(seen.mean(), scale ** -2, atol=0.02) and not seen[:, :int(margin * SIZE[0]) - 1].any()
    assert np.array_equal(read(tmp_path / "aligned" / "IMG_2.png"), read(stack / "IMG_2.png"))
    # Fused again, they need no alignment, and nothing of this is taken for a frame of the stack.
    done = succeeded(fuse_stack(tmp_path / "aligned", "--output", tmp_path / "again.png"))
    assert "5 of 5 frames" in done.stderr
    assert cv2.PSNR(read(tmp_path / "again.png")[inside], read(tmp_path / "o.png")[inside]) > 40


def test_the_folder_holds_the_frames_of_the_last_run_only(stack, tmp_path):
    aligned = tmp_path / "aligned"
    succeeded(fuse_stack(stack, "--output", tmp_path / "o.png", "--save-aligned", aligned))
    (stack / "IMG_4.png").unlink()
    succeeded(fuse_stack(stack, "--output", tmp_path / "o.png", "--save-aligned", aligned))
    assert sorted(path.name for path in aligned.iterdir()) == ["IMG_0.png", "IMG_1.JPG.png", "IMG_2.png", "IMG_3.png"]
    (aligned / "mine.txt").write_text("keep")
    with unchanged(tmp_path):
        expect_refusal(fuse_stack(stack, "--output", tmp_path / "o.png", "--save-aligned", aligned), "fuse_stack",
                       "the folder holds mine.txt, which an earlier run has not left there")
        expect_refusal(fuse_stack(stack, "--output", tmp_path / "o.png", "--save-aligned", stack), "fuse_stack",
                       "which an earlier run has not left there")
        expect_refusal(fuse_stack(stack, "--output", tmp_path / "o.png", "--save-aligned", tmp_path / "new", "--mode", "paper"),
                       "fuse_stack", "mode paper aligns no frames")


def test_other_results_in_the_folder_stay(stack, tmp_path):
    results = tmp_path / "results"
    results.mkdir()
    succeeded(fuse_stack(stack, "--output", results / "o.png"))
    succeeded(fuse_stack(stack, "--output", tmp_path / "o.png", "--save-aligned", tmp_path / "aligned"))
    with unchanged(tmp_path):
        expect_refusal(fuse_stack(stack, "--output", tmp_path / "x.png", "--save-aligned", results), "fuse_stack",
                       "the folder holds o.png, which an earlier run has not left there")
        expect_refusal(fuse_stack(stack, "--output", tmp_path / "aligned" / "IMG_2.png", "--save-aligned", tmp_path / "aligned"),
                       "fuse_stack", "two outputs for this one file")
        expect_refusal(fuse_stack(tmp_path / "aligned", "--output", tmp_path / "x.png", "--save-aligned", tmp_path / "aligned"),
                       "fuse_stack", "would replace what --stack reads")


def test_a_frame_that_is_left_out_is_not_written(stack, tmp_path):
    random = np.random.default_rng(9)
    other = cv2.resize(random.integers(0, 256, (15, 20, 3)).astype(np.uint8), SIZE, interpolation=cv2.INTER_NEAREST)
    write(stack / "IMG_4.png", other)
    done = succeeded(fuse_stack(stack, "--output", tmp_path / "o.png", "--save-aligned", tmp_path / "aligned"))
    assert "4 of 5 frames" in done.stderr
    assert not (tmp_path / "aligned" / "IMG_4.png").exists() and len(snapshot(tmp_path / "aligned")) == 4


def test_nothing_is_left_of_a_run_that_fails(stack, tmp_path):
    data = (stack / "IMG_4.png").read_bytes()
    (stack / "IMG_4.png").write_bytes(data[:len(data) // 2])
    with unchanged(tmp_path):
        expect_refusal(run_tool("fuse_stack", stack, "--output", tmp_path / "o.png", "--save-aligned", tmp_path / "new"),
                       "fuse_stack", "cut short")


def test_crop(stack, tmp_path):
    whole, small = tmp_path / "whole.png", tmp_path / "small.png"
    succeeded(fuse_stack(stack, "--output", whole, "--save-source-index", tmp_path / "index.png"))
    succeeded(fuse_stack(stack, "--output", small, "--crop", "--save-source-index", tmp_path / "small_index.png", "--report",
                         tmp_path / "r.json"))
    picture, part = read(whole), read(small)
    margin = [round((1 - 1 / max(SCALES)) / 2 * length) for length in SIZE]
    assert np.abs(np.subtract(part.shape[1::-1], np.subtract(SIZE, np.multiply(2, margin)))).max() <= 4
    note, = [note for note in read_report(tmp_path / "r.json")["notes"] if note.startswith("cropped to ")]
    x, y = (int(number) for number in note.split(" at ")[1].split(", which")[0].split(", "))
    inside = (slice(y, y + part.shape[0]), slice(x, x + part.shape[1]))
    assert np.array_equal(part, picture[inside])
    assert np.array_equal(read(tmp_path / "small_index.png"), read(tmp_path / "index.png")[inside])
    for name in ("IMG_0.png", "IMG_1.JPG.png", "IMG_3.png", "IMG_4.png"):
        (stack / name).unlink()
    succeeded(fuse_stack(stack, "--output", small, "--crop"))
    assert read(small).shape[1::-1] == SIZE  # nothing to cut off
