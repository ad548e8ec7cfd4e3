# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measures of quality, and what evaluate makes of them: means, depth, programs of others, the suites."""
import re

import cv2
import numpy as np
import pytest
import yaml
from evaluate_helpers import make_scene, results
from file_helpers import call
from skimage.metrics import structural_similarity
from tool_helpers import expect_refusal, tool

from all_in_focus.files.rig import Optics
from all_in_focus.files.stack import read_image
from all_in_focus_lab.baselines.alignment import align
from all_in_focus_lab.benchmark import methods, scenes as scenes_on_disk, tables as t
from all_in_focus_lab.benchmark.scenes import SUITES
from all_in_focus_lab.metrics.kept_contrast import kept_contrast, roughness
from all_in_focus_lab.metrics.truth import blur_per_inverse_depth, depth_errors, near_depth_edges, psnr, ssim

COPY = "copy=cp {stack}/000.png {output}"


def compare(*arguments):
    """Run evaluate with the cheapest of the metrics; what it prints is parsed by `tables`."""
    return call("evaluate", *arguments, "--metrics", "kept_contrast")


def tables(markdown):
    """title -> row name -> column name -> text."""
    result, blocks = {}, markdown.strip().split("\n\n")
    for title, block in zip(blocks[::2], blocks[1::2]):
        header, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines())
        result[title] = {row[0]: dict(zip(header[1:], row[1:])) for row in rows}
    return result


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Two small scenes of three frames, the second with breathing."""
    folder = tmp_path_factory.mktemp("scenes")
    for name, breathing in (("still", 0), ("breathing", 1)):
        make_scene(folder / name, breathing=breathing)
    return folder


def scene_at(path):
    scene, = scenes_on_disk.find({"path": str(path)})
    return scene


# --- measures ---------------------------------------------------------------------------------------------------------

def test_measures_of_known_images():
    random = np.random.default_rng(0)
    truth = random.integers(0, 256, (40, 60, 3), np.uint8)
    noisy = np.uint8(np.clip(truth + random.normal(0, 20, truth.shape), 0, 255))
    assert psnr(truth, truth) == np.inf and ssim(truth, truth) == 1
    assert psnr(np.uint8(truth // 2), np.uint8(truth // 2 + 10)) == pytest.approx(20 * np.log10(255 / 10))
    assert 0.5 < ssim(noisy, truth) < 1
    gray = structural_similarity(truth[..., 0], noisy[..., 0], gaussian_weights=True, sigma=1.5,
                                 use_sample_covariance=False, data_range=255)
    assert ssim(noisy[..., [0, 0, 0]], truth[..., [0, 0, 0]]) == pytest.approx(gray)
    for measure in (psnr, ssim):
        with pytest.raises(ValueError, match="differ in size: 60x40 and 60x30"):
            measure(truth, truth[:30])


def test_near_depth_edges():
    depth = np.full((40, 60), 2000, np.uint16)
    depth[:, 30:] = 1000
    near = near_depth_edges(depth, 0.1)
    assert near[:, 22:39].all() and not near[:, :22].any() and not near[:, 39:].any()
    assert not near_depth_edges(depth, 0.6).any()


def test_depth_errors_of_known_maps():
    truth = np.full((10, 20), 1000, np.uint16)
    truth[:, 10:] = 2000
    truth[0, 0] = 0
    blur = blur_per_inverse_depth(Optics(50, 2, 0.03), 2000, [1050, 4000])
    assert blur == pytest.approx(50 ** 2 / (2 * 2 * 50 / 2000) * 1050 / 1000)  # f^2 / (2 F pitch) u / (u - f)
    assert depth_errors(truth, truth, blur) == (0, 0)
    depth = truth.copy()
    depth[5] = 0  # holes
    depth[:5, 10:] = 1 / (1 / 2000 + 1.1 / blur)  # too near by a little more than 1 px of blur
    depth[6:, 10:] = 1 / (1 / 2000 + 0.9 / blur)
    share, rmse = depth_errors(depth, truth, blur)
    assert share == (20 + 50) / 199
    assert rmse == pytest.approx(1000 / blur * np.sqrt((50 * 1.1 ** 2 + 40 * 0.9 ** 2) / 179), rel=0.01)


def two_frames():
    """(near, far, all in focus): texture of every scale, of which each frame shows one half blurred, and a flat corner."""
    size = (256, 320)
    random, sharp = np.random.default_rng(0), np.zeros(size)
    for sigma in (0.7, 2, 6, 18):
        texture = cv2.GaussianBlur(random.normal(size=size), (0, 0), sigma)
        sharp += 20 * texture / texture.std()
    sharp = np.clip(128 + sharp, 0, 255)
    sharp[:64, :128] = 128
    left = np.arange(size[1]) < size[1] // 2
    blurred = cv2.GaussianBlur(sharp, (0, 0), 4)
    return [np.uint8(image) for image in (np.where(left, sharp, blurred), np.where(left, blurred, sharp), sharp)]


def test_kept_contrast_of_known_images():
    near, far, sharp = two_frames()
    assert len(kept_contrast([near, far], sharp)) == 4  # until the short side is below 24 pixels
    assert min(kept_contrast([near, far], sharp)) > 0.98
    assert kept_contrast([near], near) == pytest.approx([1] * 4)
    one = kept_contrast([near, far], near)
    assert 0.4 < one[0] < 0.6 and one == sorted(one), "half of what is fine is lost, less of what is coarse"
    mean = kept_contrast([near, far], np.uint8((np.float32(near) + far) / 2))
    assert mean[0] == pytest.approx(0.5, abs=0.05) and one[3] < 1 and mean[3] < 1
    boosted = np.clip(128 + 1.5 * (np.float64(sharp) - 128), 0, 255).astype(np.uint8)
    assert max(kept_contrast([near, far], boosted)) <= 1, "halos count for nothing"
    colour = [np.dstack([image] * 3) for image in (near, far, sharp)]
    assert kept_contrast(colour[:2], colour[2]) == pytest.approx(kept_contrast([near, far], sharp))


def test_kept_contrast_is_not_of_noise():
    """A mean of many frames has less noise: that is no contrast lost."""
    _, _, sharp = two_frames()
    random = np.random.default_rng(1)
    frames = [np.uint8(np.clip(sharp + random.normal(0, 5, sharp.shape), 0, 255)) for _ in range(8)]
    assert min(kept_contrast(frames, np.uint8(np.mean(frames, axis=0)))) > 0.93


def test_kept_contrast_follows_the_scale():
    near, far, sharp = (image.repeat(4, axis=0).repeat(4, axis=1) for image in two_frames())
    small, large = kept_contrast(two_frames()[:2], two_frames()[0]), kept_contrast([near, far], near)
    assert len(large) == 6 and large[2:5] == pytest.approx(small[:3], abs=0.1)


def test_kept_contrast_of_nothing():
    flat = np.full((70, 90), 7, np.uint8)
    assert np.isnan(kept_contrast([flat], flat)).all()
    with pytest.raises(ValueError, match="differ in size: 90x70 and 90x30"):
        kept_contrast([flat], flat[:30])
    with pytest.raises(ValueError, match="at least one frame"):
        kept_contrast([], flat)


def test_roughness_of_known_maps():
    rows, columns = np.indices((40, 60))
    assert roughness(np.uint16(columns >= 30)) == 40 / (40 * 59 + 39 * 60)
    assert roughness(np.uint16((rows + columns) % 2)) == 1 and roughness(np.uint16(0 * rows)) == 0
    unknown = np.where(columns < 30, 65535, rows % 2).astype(np.uint16)
    assert roughness(unknown) == 39 * 30 / (40 * 29 + 39 * 30)
    assert np.isnan(roughness(np.full((4, 4), 65535, np.uint16)))


# --- methods ----------------------------------------------------------------------------------------------------------

def test_lists_of_methods():
    assert methods.split("paper,refined:-alignment,gain,gf+ecc,refined:no-depth,oracle") == [
        "paper", "refined:-alignment,gain", "gf+ecc", "refined:no-depth", "oracle"]
    for name in ("single", "gf+ecc", "paper:no-depth", "restored:frames", "restored:no-depth+aperture*4",
                 "refined:focus-reversed", "mine"):
        assert callable(methods.find(name, {"mine": "true"}, "fuse_stack"))
    for name in ("median", "single+ecc", "refined:", "refined:aperture", "gf:no-depth", ""):
        with pytest.raises(ValueError, match=f"no method is named '{re.escape(name)}'"):
            methods.find(name, {}, "fuse_stack")


def test_bounds_know_the_truth(scenes):
    for scene in ("still", "breathing"):
        truth = read_image(scenes / scene / "truth.png")
        values = {name: psnr(make(scene_at(scenes / scene)).fused, truth) for name, make in methods.BOUNDS.items()}
        assert values["single"] < values["oracle"] and values["single"] + 1 < values["true-depth"]


@pytest.mark.parametrize("mode, variant, expected, hidden", [
    ("refined", "", ["--rig", "--depth", "--mode refined"], []),
    ("refined", "-alignment,gain", ["--rig", "--depth", "--without alignment,gain"], []),
    ("refined", "no-depth", ["--focus"], ["--depth", "--rig"]),
    ("restored", "no-depth", ["--focus", "--rig", "--mode restored", "--save-depth"], ["--depth"]),
    ("restored", "frames", ["--stack"], ["--rig", "--focus", "--depth", "--optics", "--save-depth"]),
    ("restored", "aperture*4", ["--rig", "--depth", "--optics 50,7.2,0.03"], []),
    ("restored", "no-depth+aperture*0.5", ["--rig", "--optics 50,0.9,0.03"], ["--depth"]),
    ("refined", "focus-reversed", ["--depth", "wrong_focus.yaml"], []),
])
def test_variants_of_fuse_stack(scenes, tmp_path, mode, variant, expected, hidden):
    said = methods.fuse_stack_command(mode, variant, "fuse_stack", scene_at(scenes / "still"), str(tmp_path))
    assert all(option in " ".join(said) for option in expected)
    assert not set(hidden) & set(said)


@pytest.mark.parametrize("wrong, expected", [
    ("focus-reversed", [2000, 1000, 500]), ("focus*4", [2000, 4000, 8000]), ("focus-late", [1 / 0.003, 500, 1000]),
    ("focus-early", [1000, 2000, 1e6])])
def test_wrong_focus_distances(tmp_path, wrong, expected):
    frames = [{"file": name, "focus_mm": focus} for name, focus in (("a", 500), ("b", 1000), ("c", 2000))]
    (tmp_path / "focus.yaml").write_text(yaml.safe_dump({"frames": frames}))
    methods.write_wrong_focus(tmp_path / "focus.yaml", wrong, tmp_path / "wrong.yaml")
    written = yaml.safe_load((tmp_path / "wrong.yaml").read_text())
    assert [frame["focus_mm"] for frame in written["frames"]] == pytest.approx(expected)


# --- the suites -------------------------------------------------------------------------------------------------------

def test_suites_name_each_scene_once():
    names = [name for scenes in SUITES.values() for name in scenes]
    assert len(names) == len(set(names)) and len(SUITES["large"]) >= 5
    assert set(SUITES["enlarged"]) == {name + "_x5" for name in SUITES["small"]} - {"clutter_large_x5"}


@pytest.mark.parametrize("name", sorted(SUITES["large"]))
def test_large_scenes_are_rendered(name, tmp_path):
    """As small pictures: the real ones take minutes each."""
    options = re.sub(r"--size \S+", "--size 96x64", re.sub(r"--frames \d+", "--frames 2", SUITES["large"][name])).split()
    result = call("make_scene", "--output", tmp_path / name, *options)
    assert (result.returncode, result.stderr) == (0, "")


# --- the program ------------------------------------------------------------------------------------------------------

def test_means_say_what_they_cover():
    of = {"a": {"x": {"values": {"PSNR": 30.0}}, "y": {"error": "none"}},
          "b": {"x": {"values": {"PSNR": 40.0}}, "y": {"values": {"PSNR": 20.0}}}}
    found = t.build(of, ["x", "y"], [])
    assert t.mean_cells(found, found.truth) == [["mean (of scenes)", "x", "y"], ["PSNR", "35.00 (2)", "20.00 (1)"]]


def test_program_compares_with_programs_of_others(scenes, tmp_path):
    arguments = [scenes / "still", scenes / "breathing", "--methods", "single,laplacian+ecc", "--peer", COPY, "--peer",
                 "copy+ecc=cp {stack}/000.png {output}", "--peer", "broken=false {output}", "--output", tmp_path / "out"]
    result = compare(*arguments)
    assert result.returncode == 1
    assert result.stderr.splitlines() == [f"evaluate: warning: {scene} broken: false ended with exit code 1"
                                          for scene in ("still", "breathing")]
    written = sorted(str(path.parent.relative_to(tmp_path / "out/results")) for path in (tmp_path / "out").rglob("fused.png"))
    assert written == [f"{scene}/{method}" for scene in ("breathing", "still")
                       for method in ("copy", "copy+ecc", "laplacian+ecc", "single")]
    means = tables(result.stdout)["Means"]
    assert means["PSNR"]["broken"] == "- (0)" and means["SSIM"]["single"].endswith(" (2)")
    found = results(tmp_path / "out")["results"]
    psnrs = {method: of["values"]["PSNR"] for method, of in found["still"].items() if "error" not in of}
    assert psnrs["laplacian+ecc"] > psnrs["single"] >= psnrs["copy"] and found["still"]["copy"]["seconds"] > 0
    aligned = align(list(scene_at(scenes / "breathing").frames()))[0]
    np.testing.assert_array_equal(read_image(tmp_path / "out/results/breathing/copy+ecc/fused.png"), aligned)

    arguments[arguments.index(COPY)] = "copy=cp {stack}/../truth.png {output}"
    compare(*arguments)
    again = results(tmp_path / "out")["results"]["still"]
    assert again["copy"]["values"]["PSNR"] is None, "infinite: another command is another method"
    assert again["single"]["run"] == found["still"]["single"]["run"], "was not measured again"


def test_program_scores_depth(scenes, tmp_path):
    """What the sensor measured, what was filled in, what mode restored found, beside each other."""
    result = compare(scenes / "still", "--methods", "refined,restored", "--fuse-stack", tool("fuse_stack"), "--output",
                     tmp_path / "out")
    assert (result.returncode, result.stderr) == (0, "")
    title, = [title for title in tables(result.stdout) if title.startswith("Depth")]
    found = tables(result.stdout)[title]
    assert list(found) == ["still", "mean"] and list(found["still"]) == ["as measured", "holes filled", "restored"]
    figures = results(tmp_path / "out")["results"]["still"]
    assert set(figures["refined"]["depths"]) == {"measured", "registered"}
    for share, rmse in figures["restored"]["depths"].values():
        assert 0 < share < 0.5 and 0 < rmse < 1
    assert figures["restored"]["depths"]["measured"][0] > figures["restored"]["depths"]["registered"][0], "holes are wrong"


def test_program_measures_photos_without_a_truth(tmp_path):
    """A folder of photos and another program: what either keeps of the contrast."""
    (tmp_path / "photos").mkdir()
    near, far, sharp = two_frames()
    for name, image in (("a.jpg", near), ("b.jpg", far)):
        cv2.imwrite(str(tmp_path / "photos" / name), image, [cv2.IMWRITE_JPEG_QUALITY, 98])
    result = compare(tmp_path / "photos", "--methods", "laplacian,single", "--peer", "first=cp {stack}/a.jpg {output}",
                     "--output", tmp_path / "out")
    assert result.returncode == 1
    complaint, = result.stderr.splitlines()
    assert complaint.endswith(f"photos single: {tmp_path / 'photos'}: no truth is known, which single needs")
    found = results(tmp_path / "out")["results"]["photos"]
    assert "PSNR" not in found["laplacian"]["values"] and "error" in found["single"]
    assert found["laplacian"]["contrast"]["kept_contrast"] > 0.97 and 0.4 < found["first"]["contrast"]["kept_contrast"] < 0.9


@pytest.mark.parametrize("arguments, reason", [
    ([], "no scenes"),
    (["nowhere"], "nowhere"),
    (["--suite", "huge"], "there are small, large, noisy"),
    (["--methods", "median", "a"], "no method is named 'median'"),
    (["--peer", "mine=true"], "expected NAME=COMMAND with {output} in it"),
    (["a/scene", "b/scene"], "two scenes are named scene"),
])
def test_bad_arguments(scenes, tmp_path, monkeypatch, arguments, reason):
    for name in ("a", "a/scene", "b/scene"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        if not (tmp_path / name).exists():
            (tmp_path / name).symlink_to(scenes / "still") if "/" in name else (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path)
    expect_refusal(compare(*arguments, "--output", tmp_path / "out"), "evaluate", reason)
