# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_rig on rendered boards whose cameras are known, and on what is no calibration."""
import shutil

import cv2
import numpy as np
import pytest
import yaml

from all_in_focus import installed
from all_in_focus.files.rig import load_rig, save_camera, save_rig

from board_rendering import board_poses, mapping_error, true_rig, write_views
from file_helpers import ENDLESS_PICTURE, call, cut, run_script
from tool_helpers import expect_refusal, succeeded, unchanged

MOVED, HIDDEN = 7, 11


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    """20 good pairs, one with a board that was moved between the pictures, one that the depth camera does not see."""
    folder = tmp_path_factory.mktemp("views") / "boards"
    write_views(folder, true_rig(), board_poses(true_rig(), 22), moved=(MOVED,))
    cv2.imwrite(str(folder / "depth" / f"{HIDDEN:02d}.png"), np.full((480, 640), 400, np.uint16))
    return folder


@pytest.fixture(scope="module")
def calibrated(views, tmp_path_factory):
    """(rig folder, what was printed)."""
    output = tmp_path_factory.mktemp("calibrated") / "rig"
    done = succeeded(call(*arguments(views, output), "--optics", "24,4,0.019", "--kinect"))
    return output, done.stdout.splitlines()


def arguments(views, output, board="8x6"):
    return ["calibrate_rig", "--depth-camera", str(views / "depth"), "--color-camera", str(views / "color"),
            "--board", board, "--square", "45", "--output", str(output)]


def refused(command):
    """The one line of an error."""
    done = call(*command)
    assert done.returncode == 2 and done.stderr.startswith("calibrate_rig: ")
    return done.stderr.strip().splitlines()[-1]


def subset(views, folder, count):
    """The first pairs only."""
    for camera in ("depth", "color"):
        (folder / camera).mkdir(parents=True)
        for path in sorted((views / camera).iterdir())[:count]:
            shutil.copy(path, folder / camera)
    return folder


def test_the_rig_maps_depth_to_color_as_the_true_one(calibrated):
    rig, truth = load_rig(str(calibrated[0])), true_rig()
    rig.depth.K[:2, 2] += (4.8, 3.9)  # what --kinect has moved
    error = mapping_error(rig, truth)
    assert error.max() < 0.3 and np.sqrt(np.mean(error ** 2)) < 0.15
    assert np.linalg.norm(rig.t - truth.t) < 0.002
    assert rig.optics.focal_length_mm == 24
    assert (rig.parent_frame, rig.child_frame) == ("dslr_optical_frame", "kinect_depth_optical_frame")


def test_bad_views_are_named_and_left_out(calibrated):
    folder, printed = calibrated
    record = yaml.safe_load((folder / "calibration.yaml").read_text())
    remarks = {int(pair["pair"]): pair.get("remark", "") for pair in record["pairs"]}
    assert "was the board moved between the two pictures?" in remarks[MOVED]
    assert remarks[HIDDEN] == "no board in the depth picture"
    assert sum(bool(remark) for remark in remarks.values()) == 2
    assert [line.split("'")[1] for line in printed if "left out" in line] == [f"{MOVED:02d}"]
    assert (record["pairs_used"], len(record["pairs"])) == (20, 22)


def test_the_report_tells_how_sure_it_is(calibrated):
    folder, printed = calibrated
    record = yaml.safe_load((folder / "calibration.yaml").read_text())
    assert record["ir_offset_px"] == [-4.8, -3.9] and record["refined_jointly"]
    assert 0.02 < record["standard_deviations"]["mapping_px"] < 0.3
    assert 0.1 < record["depth"]["standard_deviations"]["fx"] < 3
    assert record["error_px"] < 0.15
    rig = load_rig(folder)
    for name, camera in (("depth", rig.depth), ("color", rig.color)):
        assert [record[name][term] for term in ("fx", "cy")] == pytest.approx([camera.K[0, 0], camera.K[1, 2]], abs=0.01)
    assert printed == [*(folder / "calibration.yaml").read_text().splitlines(), f"wrote {folder}"]


def test_the_tools_in_cpp_read_the_rig(calibrated, tmp_path):
    (tmp_path / "stack").mkdir()
    cv2.imwrite(str(tmp_path / "stack" / "0.png"), np.full((600, 800, 3), 90, np.uint8))
    cv2.imwrite(str(tmp_path / "depth.png"), np.full((480, 640), 1500, np.uint16))
    installed.run([installed.find("fuse_stack"), "--stack", str(tmp_path / "stack"), "--rig", str(calibrated[0]),
                   "--depth", str(tmp_path / "depth.png"), "--output", str(tmp_path / "o.png"),
                   "--save-registered", str(tmp_path / "z.png")])
    registered = cv2.imread(str(tmp_path / "z.png"), cv2.IMREAD_UNCHANGED)
    assert abs(np.median(registered[registered > 0]) - 1521) < 25  # the depth camera is 21 mm behind


def test_a_rig_without_a_lens_is_told(views, tmp_path):
    few = subset(views, tmp_path / "few", 6)
    for options, told in (((), True), (("--force", "--optics", "24,4,0.019"), False), (("--force",), False)):
        done = succeeded(call(*arguments(few, tmp_path / "rig"), *options))
        assert ("no lens: robot.launch needs" in done.stdout) == told
    assert load_rig(tmp_path / "rig").optics.focal_length_mm == 24  # of the run before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["few", "rig"]


def test_an_existing_rig_stays(calibrated, views):
    before = (calibrated[0] / "depth.yaml").read_bytes()
    assert "holds a rig already" in refused(arguments(views, calibrated[0]))
    assert (calibrated[0] / "depth.yaml").read_bytes() == before
    assert sorted(path.name for path in calibrated[0].parent.iterdir()) == ["rig"]


def test_force_does_not_replace_a_rig_of_others(views, tmp_path):
    few, rig = subset(views, tmp_path / "few", 6), tmp_path / "rig"
    save_rig(str(rig), true_rig())
    with unchanged(rig):
        assert "was not written by calibrate_rig" in refused([*arguments(few, rig), "--force"])


def test_known_cameras_stay_as_they_are_and_force_replaces(views, tmp_path):
    truth, few, rig = true_rig(), subset(views, tmp_path / "few", 6), tmp_path / "rig"
    rig.mkdir()
    (rig / "optics.yaml").write_text("focal_length_mm: 35\naperture: 2\ncircle_of_confusion_mm: 0.02\n")
    (rig / "notes.txt").write_text("mine")
    for name in ("depth", "color"):
        save_camera(str(tmp_path / f"{name}.yaml"), getattr(truth, name))
    known = ["--depth-info", str(tmp_path / "depth.yaml"), "--color-info", str(tmp_path / "color.yaml"), "--force",
             "--ir-offset", "-1.5,2"]
    assert succeeded(call(*arguments(few, rig), *known)).stdout.count("known: true") == 2
    found = load_rig(str(rig))
    assert np.array_equal(found.color.K, truth.color.K) and np.array_equal(found.color.D, truth.color.D)
    assert np.allclose(found.depth.K - truth.depth.K, [[0, 0, -1.5], [0, 0, 2], [0, 0, 0]])
    assert np.linalg.norm(found.t - truth.t) < 0.002
    assert found.optics.focal_length_mm == 35 and (rig / "notes.txt").exists()


def test_pictures_that_cannot_be_read_are_named_and_left_out(views, tmp_path):
    some = subset(views, tmp_path / "some", 8)
    cut(some / "depth" / "02.png")
    (some / "color" / "05.jpg").write_bytes(ENDLESS_PICTURE)
    done = succeeded(call(*arguments(some, tmp_path / "rig")))
    wrong = {"02": f"{some / 'depth' / '02.png'}: truncated or damaged",
             "05": f"{some / 'color' / '05.jpg'}: not a readable image"}
    for complaint in wrong.values():
        assert f"calibrate_rig: warning: {complaint}: left out\n" in done.stderr and complaint in done.stdout
    record = yaml.safe_load((tmp_path / "rig" / "calibration.yaml").read_text())
    assert {pair["pair"]: pair["remark"] for pair in record["pairs"] if pair["pair"] in wrong} == wrong


def test_too_few_pictures_that_can_be_read(views, tmp_path):
    few = subset(views, tmp_path / "few", 5)
    for name in ("00", "04"):
        (few / "depth" / f"{name}.png").write_bytes(b"")
    done = call(*arguments(few, tmp_path / "rig"))
    said = done.stderr.splitlines()
    assert done.returncode == 2 and [line.endswith("not a readable image: left out") for line in said] == [True, True, False]
    assert "the depth camera: 3 usable views of the board, at least 5 are needed" in said[-1]
    for path in (few / "color").iterdir():
        cut(path, 0.1)
    assert refused(arguments(few, tmp_path / "rig")) == f"calibrate_rig: {few / 'color'}: none of the 5 pictures can be read"
    assert not (tmp_path / "rig").exists()


def test_too_few_views(views, tmp_path):
    few = subset(views, tmp_path / "few", 3)
    assert "the depth camera: 3 usable views of the board, at least 5 are needed" in refused(
        arguments(few, tmp_path / "rig"))
    assert not (tmp_path / "rig").exists()


def test_a_board_of_another_size(views, tmp_path):
    few = subset(views, tmp_path / "few", 2)
    (few / "depth" / "00.png").write_bytes(b"")
    said = refused(arguments(few, tmp_path / "rig", "9x7"))
    assert "no board of 9x7 inner corners" in said
    assert "--board counts the corners inside" in said


def test_no_board_anywhere(tmp_path):
    for camera in ("depth", "color"):
        (tmp_path / camera).mkdir()
        cv2.imwrite(str(tmp_path / camera / "0.png"), np.full((120, 160), 100, np.uint8))
    said = refused(arguments(tmp_path, tmp_path / "rig"))
    assert "no board of 8x6 inner corners in any of 1 pairs: --board counts the corners inside" in said


def test_pictures_of_different_sizes(tmp_path):
    for camera in ("depth", "color"):
        (tmp_path / camera).mkdir()
        for number in (0, 1):
            cv2.imwrite(str(tmp_path / camera / f"{number}.png"), np.full((120, 160 + number), 100, np.uint8))
    assert "1.png: 161x120 pixels, but the depth camera's pictures before it have 160x120" in refused(
        arguments(tmp_path, tmp_path / "rig"))


def test_names_without_a_counterpart(tmp_path):
    for camera, names in (("depth", "ab"), ("color", "c")):
        (tmp_path / camera).mkdir()
        for name in names:
            cv2.imwrite(str(tmp_path / camera / f"{name}.png"), np.full((120, 160), 100, np.uint8))
    argv = arguments(tmp_path, tmp_path / "rig")
    assert "has a counterpart of the same name" in refused(argv)
    (tmp_path / "color" / "a.png").write_bytes((tmp_path / "depth" / "a.png").read_bytes())
    done = call(*argv)
    assert done.returncode == 2 and all(f"is named like {name}: left out" in done.stderr for name in "bc")
    (tmp_path / "color" / "a.jpg").write_bytes(b"")
    assert "a.jpg and a.png differ in their ending only" in refused(argv)


@pytest.mark.parametrize("options, words", [
    (["--board", "8"], "argument --board: '8': expected the number of inner corners"),
    (["--board", "8x2"], "at least 3 each way"),
    (["--square", "-1"], "expected a positive number"),
    (["--square", "1e9"], "of mm, from 1 to 1000"),
    (["--live"], "give --depth-camera and --color-camera, or --live"),
    (["--ir-offset", "3"], "expected X,Y in pixels"),
    (["--depth-info", "none.yaml"], "none.yaml: No such file"),
    (["--depth-camera", "nowhere"], "nowhere: No such file or directory"),
])
def test_wrong_arguments(tmp_path, options, words):
    for camera in ("depth", "color"):
        (tmp_path / camera).mkdir()
    assert words in refused(arguments(tmp_path, tmp_path / "rig") + options)


@pytest.mark.parametrize("source", ["--live", "--depth-camera=boards --color-camera=boards"])
def test_a_folder_that_cannot_be_written_is_told_before_the_work(tmp_path, source):
    """Before there is a node, too: nobody has to take the views twice."""
    (tmp_path / "file").write_text("")
    said = refused(["calibrate_rig", *source.split(), "--board", "8x6", "--square", "45", "--output",
                    str(tmp_path / "file" / "rig")])
    assert said == f"calibrate_rig: {tmp_path / 'file' / 'rig'}: Not a directory"


def test_the_script():
    result = run_script("calibrate_rig", "--help")
    assert result.returncode == 0 and "--ir-offset" in result.stdout
    expect_refusal(call("calibrate_rig"), "calibrate_rig")
