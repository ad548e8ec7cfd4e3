# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Driving the focus of each maker's camera, and the focus distance of a step."""
import math
import re
from pathlib import Path

import pytest

import fake_camera
from all_in_focus.camera import bracket, focus_drive, interface
from all_in_focus.camera.focus_drive import FocusDrive, FocusLimit
from all_in_focus.camera.interface import BUSY, CAMERA_ERROR, CameraError, RetryingCamera
from all_in_focus.camera.makers import MAKERS, maker_of
from all_in_focus.files.focus_table import FocusTable
from fake_camera import LENS, MODELS, FakeCamera
from file_helpers import VirtualTime

# Motor positions of one step of the size that the table takes by default.
STEP = {"Canon EOS": 10, "Nikon": 100, "Sony": 10, "Fuji": 10, "Panasonic": 10}


@pytest.fixture(autouse=True)
def virtual_time(monkeypatch):
    return VirtualTime(monkeypatch, bracket, fake_camera, focus_drive, interface)


def drive_of(make, lens=400, **options):
    camera = FakeCamera(make, lens=lens)
    camera.open()
    if make == "Sony":
        camera.set_config("focusmode", "Manual")
    return camera, FocusDrive(camera, maker_of(MODELS[make]), settle_s=0, **options)


@pytest.mark.parametrize("make", STEP)
def test_steps_there_and_back(make):
    camera, drive = drive_of(make)
    for position in (1, 3, -2, -2, 0):
        drive.move_to(position)
        assert (drive.position, camera.lens) == (position, 400 + position * STEP[make])


def test_equal_canon_steps_have_a_none_between():
    camera, drive = drive_of("Canon EOS", size=2)
    drive.move_to(2)
    assert camera.log[1:] == [("manualfocusdrive", "None"), ("manualfocusdrive", "Far 2")] * 2
    assert camera.lens == 500
    # The fake obeys the same rule as the camera: the second of two equal choices does nothing.
    camera.set_config("manualfocusdrive", "Far 2")
    assert camera.lens == 500


@pytest.mark.parametrize("make, size", [("Canon EOS", 4), ("Panasonic", 3), ("Sony", 8)])
def test_a_size_that_the_maker_does_not_have(make, size):
    with pytest.raises(CameraError, match=f"step_size {size}: .*take 1 to {size - 1}"):
        drive_of(make, size=size)


@pytest.mark.parametrize("make, reached", [("Nikon", 5), ("Fuji", 55)])
def test_the_limit_is_told_and_the_count_stays_right(make, reached):
    camera, drive = drive_of(make, lens=LENS - reached * STEP[make] - 3)
    start = camera.lens
    with pytest.raises(FocusLimit, match="far limit"):
        drive.move_to(reached + 2)
    assert drive.position == reached
    drive.move_to(0)
    assert abs(camera.lens - start) <= (3 if make == "Nikon" else 0)


def test_a_position_as_text():
    """libgphoto2 gives properties that it has no name for as texts."""
    camera = FakeCamera("Fuji")
    camera.open()
    camera.widgets["d171"] = camera.widgets.pop("focuspos")
    camera.widgets["d171"].value, camera.widgets["d171"].low = "400", None
    drive = FocusDrive(camera, maker_of("Fuji"), settle_s=0)
    camera.widgets["d171"].value = "430"  # as it is read back
    drive.move_to(3)
    assert camera.log == [("d171", 430)]
    with pytest.raises(CameraError, match="'None' is not a position"):
        drive.go_to_stop()


def test_home_is_the_near_stop():
    for make in STEP:
        camera, drive = drive_of(make)
        drive.go_to_stop()
        assert (camera.lens, drive.position) == (0, 0), make
        drive.move_to(2)
        assert camera.lens == 2 * STEP[make], make
        drive.go_to_stop(far=True)
        assert (camera.lens, drive.position) == (LENS, 0), make


def test_live_view_comes_back_after_a_picture():
    camera, drive = drive_of("Nikon")
    drive.move_to(1)
    camera.capture()
    drive.move_to(2)
    assert camera.lens == 600


def test_no_drive_is_explained():
    camera = FakeCamera("none")
    camera.open()
    with pytest.raises(CameraError, match="no widget focuspos or d171"):
        FocusDrive(camera, maker_of("Fujifilm"))


def test_every_model_has_its_row():
    assert {maker_of(model).name for make, model in MODELS.items() if make != "none"} == set(STEP)
    assert maker_of(MODELS["none"]) is None and maker_of("USB PTP Class Camera", "Nikon Corporation").name == "Nikon"
    assert all(maker.sizes[0] <= maker.typical <= maker.sizes[1] for maker in MAKERS)


def test_the_table_of_makers_is_the_one_in_the_documentation():
    text = (Path(__file__).resolve().parent.parent / "docs" / "dslr.md").read_text()
    for maker in MAKERS:
        cells = [cell.strip() for cell in re.search(rf"^\| {maker.name} \|.*$", text, re.M)[0].strip("|").split("|")]
        assert re.findall("`(.*?)`", cells[1]) == list(maker.widgets)
        assert cells[3:5] == [f"{maker.sizes[0]} to {maker.sizes[1]}, {maker.typical}", f"{maker.settle_s:g} s"]
        assert (cells[5] == "on", cells[6] == "yes") == (maker.live_view, maker.reports_limit)
        assert re.findall("`(.*?)`", cells[7]) == [name for name, _ in maker.holds]


def test_busy_is_retried_other_errors_are_not():
    camera = FakeCamera()
    retrying = RetryingCamera(camera, patience=2)
    retrying.open()
    camera.busy = 4
    retrying.set_config("iso", "200")
    assert (camera.busy, camera.log) == (0, [("iso", "200")])
    camera.fail = (CAMERA_ERROR, 1)
    with pytest.raises(CameraError) as failure:
        retrying.set_config("iso", "100")
    assert failure.value.code == CAMERA_ERROR and len(camera.log) == 1
    camera.busy = 10 ** 6
    with pytest.raises(CameraError, match="busy: it is still writing") as failure:
        RetryingCamera(camera, patience=0.2).capture()
    assert failure.value.code == BUSY and not failure.value.lost


def test_the_moment_of_the_release_is_that_of_the_last_attempt():
    camera, attempts = FakeCamera(), []
    camera.open()
    camera.busy = 2
    RetryingCamera(camera).capture(lambda: attempts.append(camera.busy))
    assert attempts == [2, 1, 0]


TABLE = [{"step": 0, "mm": 500}, {"step": 10, "mm": 1000}, {"step": 20, "mm": math.inf}]


def test_scale_interpolates_dioptres():
    scale = FocusTable(TABLE)
    assert [scale.distance(step) for step in (0, 10, 20)] == [0.5, 1.0, math.inf]
    assert scale.distance(5) == pytest.approx(1 / 1.5) and scale.distance(15) == pytest.approx(2.0)
    assert math.isnan(scale.distance(-1)) and math.isnan(scale.distance(21))
    for step in range(21):
        assert scale.nearest_step(scale.distance(step)) == step
    assert [scale.nearest_step(0.1), scale.nearest_step(math.inf)] == [0, 20]
    assert scale.reaches(0.5) and scale.reaches(math.inf) and not scale.reaches(0.49)
    falling = FocusTable([{"step": -row["step"], "mm": row["mm"]} for row in TABLE])
    assert falling.distance(-5) == pytest.approx(1 / 1.5) and falling.nearest_step(2.0) == -15


@pytest.mark.parametrize("table", [[], TABLE[:1], [{"step": 0}], 5, [{"step": 0, "mm": 1}, {"step": 0, "mm": 2}],
                                   [{"step": 0, "mm": 1}, {"step": 1, "mm": -2}], TABLE + [{"step": 30, "mm": 600}]])
def test_impossible_scales_are_refused(table):
    with pytest.raises(ValueError, match="^focus_table: "):
        FocusTable(table)
