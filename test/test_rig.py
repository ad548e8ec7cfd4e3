# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rig files."""
import numpy as np
import pytest
import yaml

from all_in_focus.files.rig import Camera, Optics, RigError, distortion_of, load_rig, save_rig
from all_in_focus_lab.simulation.presets import kinect_beside
from file_helpers import write_stack
from tool_helpers import fuse_stack

OPTICS = Optics(50.0, 2.0, 0.03)


def save_changed_rig(folder, name, old, new):
    """A rig, in one file of which something else is written."""
    save_rig(folder, kinect_beside(Camera.pinhole("dslr", 640, 480, 810, 811, 320, 240), OPTICS))
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))


def test_rig_round_trip(tmp_path):
    rig = kinect_beside(Camera.pinhole("dslr", 741, 500, 994.978, 993.5, 311.193, 254.877), OPTICS)
    rig.color.D = np.array([0.1, -0.02, 1e-5, 2e-4, 0.0])
    save_rig(tmp_path / "rig", rig)
    back = load_rig(tmp_path / "rig")
    assert np.allclose(back.R, rig.R, atol=1e-14) and np.array_equal(back.t, rig.t)
    assert back.optics == rig.optics
    assert (back.parent_frame, back.child_frame) == ("dslr_optical_frame", "kinect_depth_optical_frame")
    for a, b in ((back.depth, rig.depth), (back.color, rig.color)):
        assert (a.name, a.width, a.height, a.distortion_model) == (b.name, b.width, b.height, b.distortion_model)
        for key in "KDRP":
            assert np.array_equal(getattr(a, key), getattr(b, key))


def test_rig_files_are_camera_info_files(tmp_path):
    save_rig(tmp_path, kinect_beside(Camera.pinhole("dslr", 640, 480, 810, 811, 320, 240), None))
    info = yaml.safe_load((tmp_path / "color.yaml").read_text())
    assert list(info) == ["image_width", "image_height", "camera_name", "camera_matrix", "distortion_model",
                          "distortion_coefficients", "rectification_matrix", "projection_matrix"]
    assert info["projection_matrix"] == {"rows": 3, "cols": 4, "data": [810, 0, 320, 0, 0, 811, 240, 0, 0, 0, 1, 0]}
    assert info["distortion_coefficients"] == {"rows": 1, "cols": 5, "data": [0] * 5}
    pose = yaml.safe_load((tmp_path / "extrinsics.yaml").read_text())
    assert sorted(pose) == ["child_frame", "parent_frame", "rotation", "translation"]
    assert np.isclose(np.linalg.norm(pose["rotation"]), 1) and pose["rotation"][3] > 0
    assert load_rig(tmp_path).optics is None


@pytest.mark.parametrize("name, old, new, message", [
    ("color.yaml", "image_width: 640", "image_width: wide", "image_width: expected 1 finite number"),
    ("color.yaml", "image_width: 640", "image_width: 640.5", "image_width: expected a positive whole number"),
    ("color.yaml", "data: [810.0, ", "data: [", "camera_matrix: expected 9 finite numbers"),
    ("color.yaml", "data: [810.0, ", "data: [-810.0, ", "camera_matrix: the camera is not calibrated (fx = -810"),
    ("depth.yaml", "plumb_bob", "fisheye", 'distortion model "fisheye" is not supported'),
    ("depth.yaml", "distortion_model", "camera_model: fisheye\ndistortion_model", "camera_model: 'fisheye' is not supported"),
    ("depth.yaml", "distortion_model", "binning_x: 4\ndistortion_model", "binning_x: is not supported"),
    ("color.yaml", "data: [810.0, 0.0, ", "data: [810.0, 2.0, ", "camera_matrix: the camera matrix has a skew, 2"),
    ("depth.yaml", "image_width: 640", "image_width: [", "not valid YAML"),
    ("extrinsics.yaml", "rotation: [", "rotation: [7.0, ", "rotation: expected 4 finite numbers"),
    ("extrinsics.yaml", "translation: [-0.03", "translation: [.nan", "translation: expected 3 finite numbers"),
    ("optics.yaml", "aperture: 2.0", "aperture: 0.0", "aperture must be 0.1 to 1000, not 0"),
    ("optics.yaml", "aperture: 2.0", "aperture: 1e-200", "aperture must be 0.1 to 1000, not 1e-200"),
    ("optics.yaml", "aperture: 2.0", "aperture: .inf", "aperture: expected 1 finite number"),
    ("optics.yaml", "aperture: 2.0", "lens: {aperture: 2,8}", "not valid YAML: a number ends with ',8': write a decimal point"),
])
def test_rig_errors_name_file_and_key(tmp_path, name, old, new, message):
    save_changed_rig(tmp_path, name, old, new)
    with pytest.raises(RigError) as error:
        load_rig(tmp_path)
    assert f"{name}: {message}" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("more", [
    "a: &a {b: *a}", "\n".join(["a0: &a0 [7]", *(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10))])])
def test_aliases_without_end_do_not_count(tmp_path, more):
    save_changed_rig(tmp_path, "optics.yaml", "aperture: 2.0", f"aperture: 2.0\n{more}")
    if "*a}" not in more:  # PyYAML refuses one that holds itself
        assert load_rig(tmp_path).optics == OPTICS
    done = fuse_stack(write_stack(tmp_path / "stack", ["0.png"]), "--rig", tmp_path, "--output", tmp_path / "o.png")
    assert done.returncode == 2 and "not the same picture" in done.stderr  # the rig was read


def test_the_pose_of_the_other_camera_is_refused(tmp_path):
    """Where names of cameras and frames tell."""
    save_changed_rig(tmp_path, "extrinsics.yaml", "parent_frame: dslr_optical_frame\nchild_frame: kinect_depth_optical_frame",
                     "parent_frame: kinect_depth_optical_frame\nchild_frame: dslr_optical_frame")
    with pytest.raises(RigError, match="parent_frame: is that of the depth camera"):
        load_rig(tmp_path)
    stack = write_stack(tmp_path / "stack", ["0.png", "1.png"])
    done = fuse_stack(stack, "--rig", tmp_path, "--output", tmp_path / "o.png")
    assert done.returncode == 2 and "extrinsics.yaml: parent_frame is that of the depth camera" in done.stderr
    for name in ("color.yaml", "depth.yaml"):  # nothing tells that these frames are exchanged
        path = tmp_path / name
        path.write_text(path.read_text().replace("camera_name: ", "camera_name: x"))
    assert load_rig(tmp_path).child_frame == "dslr_optical_frame"


@pytest.mark.parametrize("written, name", [("14050028", "14050028"), ("0123", "0123"), ("1e5", "1e5"), ("on", "on"),
                                           ("'7'", "7"), ("my camera", "my camera")])
def test_names_that_look_like_numbers(tmp_path, written, name):
    """camera_calibration writes serial numbers unquoted."""
    save_changed_rig(tmp_path, "color.yaml", "camera_name: dslr", f"camera_name: {written}")
    rig = load_rig(tmp_path)
    assert rig.color.name == name
    save_rig(tmp_path / "again", rig)
    assert yaml.safe_load((tmp_path / "again" / "color.yaml").read_text())["camera_name"] == name
    assert load_rig(tmp_path / "again").color.name == name


@pytest.mark.parametrize("written", ["", "~", "[1, 2]", "{a: b}"])
def test_names_that_are_none(tmp_path, written):
    save_changed_rig(tmp_path, "color.yaml", "camera_name: dslr", f"camera_name: {written}")
    with pytest.raises(RigError, match="camera_name: (expected a name|missing)"):
        load_rig(tmp_path)


def test_distortion_of_eight_zeros(tmp_path):
    """Many drivers write eight numbers whatever the model."""
    for last, good in (("0.0", True), ("0.1", False)):
        save_changed_rig(tmp_path, "color.yaml", "cols: 5\n  data: [0.0, 0.0, 0.0, 0.0, 0.0]",
                         f"cols: 8\n  data: [0, 0, 0, 0, 0, 0, 0, {last}]")
        if good:
            assert not load_rig(tmp_path).color.D.any()
        else:
            with pytest.raises(RigError, match="plumb_bob has 5 distortion coefficients, not 8"):
                load_rig(tmp_path)


def test_a_misspelt_distortion_is_not_none(tmp_path):
    save_changed_rig(tmp_path, "depth.yaml", "distortion_coefficients", "distortion_coeficients")
    with pytest.raises(RigError, match="depth.yaml: distortion_coefficients: expected finite numbers"):
        load_rig(tmp_path)
    stack = write_stack(tmp_path / "stack", ["0.png", "1.png"])
    done = fuse_stack(stack, "--rig", tmp_path, "--output", tmp_path / "o.png")
    assert done.returncode == 2 and "depth.yaml: key 'distortion_coefficients' is missing" in done.stderr


def test_rig_without_file(tmp_path):
    with pytest.raises(RigError, match="depth.yaml: No such file"):
        load_rig(tmp_path)


@pytest.mark.parametrize("model, coefficients, wanted", [
    ("plumb_bob", [0.0] * 8, [0.0] * 5),  # as many drivers publish
    ("plumb_bob", [0.1, 0.2, 0.3, 0.4], [0.1, 0.2, 0.3, 0.4, 0.0]),
    ("rational_polynomial", [0.1] * 5, [0.1] * 5 + [0.0] * 3),
    ("rational_polynomial", [0.1] * 8 + [0.0] * 6, [0.1] * 8),
    ("equidistant", [0.1] * 4 + [0.0], [0.1] * 4),
])
def test_distortion_may_be_padded_with_zeros(model, coefficients, wanted):
    assert distortion_of(model, coefficients).tolist() == wanted


@pytest.mark.parametrize("model, coefficients, message", [
    ("plumb_bob", [0.0] * 7 + [1e-9], "plumb_bob has 5 distortion coefficients, not 8"),
    ("plumb_bob", [0.0] * 9, "not 9"),
    ("rational_polynomial", [float("nan")] * 8, "all finite"),
    ("equidistant", [0.0] * 4 + [0.1], "equidistant has 4 distortion coefficients, not 5"),
    ("omni", [0.0] * 4, '"omni" is not supported'),
])
def test_distortion_of_another_model_is_refused(model, coefficients, message):
    with pytest.raises(ValueError, match=message):
        distortion_of(model, coefficients)
