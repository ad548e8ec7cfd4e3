# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Brackets: frames, fixed settings, restoring, and errors of the camera."""
import contextlib
import itertools
import math

import pytest

import fake_camera
from all_in_focus.camera import bracket, focus_drive, interface
from all_in_focus.camera.focus_drive import FocusLimit
from all_in_focus.camera.interface import (BUSY, CAMERA_ERROR, CORRUPTED, IO_WRITE, MODEL_NOT_FOUND, NO_SPACE,
                                           USB_CLAIM, CameraError)
from all_in_focus.camera.session import Session
from fake_camera import LENS, MODELS, FakeCamera, camera_settings, lens_of
from file_helpers import ENDLESS_PICTURE, VirtualTime

MAKES = [make for make in MODELS if make != "none"]
SETTINGS = ("iso", "whitebalance", "shutterspeed", "autofocus", "autoexposuremode", "expprogram")
TABLE = [{"step": 0, "mm": 500}, {"step": 100, "mm": math.inf}]  # of all 1000 motor positions


@pytest.fixture(autouse=True)
def virtual_time(monkeypatch):
    return VirtualTime(monkeypatch, bracket, fake_camera, focus_drive, interface)


def connected(camera, **config):
    session = Session(camera, camera_settings(**{"settle": 0, "count": 3, "patience": 1, "timeout": 1, **config}),
                      itertools.count().__next__)
    session.connect()
    return session


def shot_with_warnings(session, publish):
    """The warnings of a bracket."""
    session.shoot(publish)
    return session.take_warnings()


def settings(camera):
    return {name: camera.widgets[name].value for name in SETTINGS if name in camera.widgets}


@pytest.mark.parametrize("frames", ["still", "preview"])
@pytest.mark.parametrize("make", MAKES)
def test_a_bracket(make, frames):
    camera, shots, seen = FakeCamera(make), [], []
    session = connected(camera, frames=frames, first=-1, step_size=3 if make == "Sony" else 0)

    def publish(shot):
        shots.append(shot)
        seen.append(settings(camera))
    before = settings(camera)
    session.shoot(publish)
    assert session.take_warnings() == []
    step = {"Sony": 30, "Nikon": 100}.get(make, 10)
    for shot, expected in zip(shots, (400 - step, 400, 400 + step)):
        assert abs(lens_of(shot.image) - expected) < 4
    assert [(shot.index, shot.count, shot.last) for shot in shots] == [(0, 3, False), (1, 3, False), (2, 3, True)]
    assert all(math.isnan(shot.distance) for shot in shots)
    assert [shot.stamp for shot in shots] == sorted({shot.stamp for shot in shots})
    # Fixed during the bracket, with the exposure as it was metered; restored afterwards.
    for held in seen:
        assert held["iso"] == "400" and held["whitebalance"] == "Daylight" and held["shutterspeed"] == "1/60"
        assert held.get("autoexposuremode", held.get("expprogram")) in ("Manual", "M")
    assert settings(camera) == before and camera.lens == 400


def test_white_balance_and_iso_from_the_parameters():
    camera, seen = FakeCamera(), []
    connected(camera, white_balance="Tungsten", iso="100").shoot(lambda shot: seen.append(settings(camera)))
    assert {(held["whitebalance"], held["iso"]) for held in seen} == {("Tungsten", "100")}


def test_a_setting_that_cannot_be_fixed_is_named():
    camera = FakeCamera()
    camera.widgets["autoexposuremode"].read_only = True  # it has a dial
    camera.widgets["whitebalance"].choices.remove("Daylight")
    camera.widgets["whitebalance"].choices.remove("Tungsten")
    warnings = shot_with_warnings(connected(camera), lambda shot: None)
    assert len(warnings) == 2
    assert "'autoexposuremode' is 'AV'" in warnings[0] and "'whitebalance' is 'Auto'" in warnings[1]


def test_an_exposure_that_the_camera_does_not_report_is_left_alone():
    """Some Canons report 'auto' instead of the metered value."""
    camera, modes = FakeCamera(), []
    camera.widgets["shutterspeed"].value = "auto"
    warnings = shot_with_warnings(connected(camera),
                                  lambda shot: modes.append(camera.widgets["autoexposuremode"].value))
    assert modes == ["AV"] * 3 and len(warnings) == 1
    assert "does not report the 'shutterspeed' that it has metered: set it to manual yourself" in warnings[0]


@pytest.mark.parametrize("frames", ["still", "preview"])
def test_the_stamp_is_taken_at_the_release(frames):
    """After the lens has moved, and just before the picture is taken."""
    camera, shots, calls = FakeCamera(), [], []
    for name in ("set_config", "capture", "capture_preview", "download"):
        def call(*arguments, name=name, was=getattr(camera, name)):
            calls.append(name)
            return was(*arguments)
        setattr(camera, name, call)
    session = Session(camera, camera_settings(settle=0, count=2, frames=frames), lambda: len(calls))
    session.connect()
    session.shoot(shots.append)
    release = "capture" if frames == "still" else "capture_preview"
    for shot in shots:
        assert calls[shot.stamp] == release
        assert calls[:shot.stamp][-1] == ("set_config" if frames == "still" else "capture_preview")


@pytest.mark.parametrize("code, data, words", [(None, b"junk", "it is not a picture"), (NO_SPACE, None, "card is full"),
                                               (None, ENDLESS_PICTURE, "it is not a picture"),
                                               (CORRUPTED, None, "sent data that cannot be read")])
def test_a_picture_that_does_not_come_ends_the_bracket(code, data, words):
    camera, shots = FakeCamera(), []
    session, before = connected(camera), settings(camera)

    def download(path):
        if code:
            raise CameraError(code, f"downloading {path}")
        return data
    camera.download = download
    with pytest.raises(CameraError, match=words):
        session.shoot(shots.append)
    assert not shots and session.connected and settings(camera) == before and camera.lens == 400


def test_raw_files_beside_the_pictures_are_left_alone():
    camera, shots = FakeCamera(raw=True), []
    connected(camera).shoot(shots.append)
    assert len(shots) == 3 and len(camera.files) == 6
    connected(camera, keep_files=False).shoot(shots.append)
    assert len(shots) == 6 and all(path.endswith("JPG") for path in camera.deleted) and len(camera.deleted) == 3


def test_raw_alone_is_explained():
    camera = FakeCamera()
    camera.capture = lambda: camera._pending.append((0, "/card/IMG_1.NEF"))
    with pytest.raises(CameraError, match="only IMG_1.NEF: let the camera write JPEG"):
        connected(camera).shoot(lambda shot: None)
    assert camera.lens == 400 and settings(camera)["iso"] == "Auto"


@pytest.mark.parametrize("idle", [False, True])
def test_a_picture_that_comes_too_late_is_not_taken_for_the_next(idle):
    camera, shots = FakeCamera(exposure=math.inf), []
    session, before = connected(camera, timeout=0.2), settings(camera)
    with pytest.raises(CameraError, match="none came in 0.2 s, is a card in the camera?"):
        session.shoot(shots.append)
    assert not shots and session.connected and settings(camera) == before and camera.lens == 400
    camera.exposure, camera.lens = 0, 700
    camera._pending = [(0, event) for _, event in camera._pending]
    if idle:
        session.check()
    session.shoot(shots.append)
    assert [round(lens_of(shot.image), -1) for shot in shots] == [700, 710, 720]


@pytest.mark.parametrize("make, lens, frames", [("Nikon", LENS - 150, 2), ("Fuji", LENS - 25, 3)])
def test_the_bracket_ends_at_the_focus_limit(make, lens, frames):
    camera, shots = FakeCamera(make, lens=lens), []
    warnings = shot_with_warnings(connected(camera, count=5), shots.append)
    assert warnings == [f"the focus is at its far limit after {frames} of 5 frames"]
    assert [shot.last for shot in shots] == [False] * (frames - 1) + [True]
    assert shots[-1].count == frames
    assert abs(camera.lens - lens) <= 50 and settings(camera)["iso"] == "Auto"


def test_no_frame_within_the_limits():
    camera, shots = FakeCamera("Nikon", lens=10), []
    with pytest.raises(FocusLimit, match="near limit"):
        connected(camera, first=-1).shoot(shots.append)
    assert not shots and settings(camera)["iso"] == "Auto"


def test_a_busy_camera_only_takes_longer():
    camera, shots = FakeCamera(latency=0.001), []

    def publish(shot):
        shots.append(shot)
        camera.busy = 3
    assert shot_with_warnings(connected(camera, patience=3), publish) == []
    assert len(shots) == 3 and camera.lens == 400


def test_latency_only_takes_longer():
    camera, shots = FakeCamera("Fuji", latency=0.02, exposure=0.1), []
    connected(camera).shoot(shots.append)
    assert [round(lens_of(shot.image), -1) for shot in shots] == [400, 410, 420] and camera.lens == 400


@pytest.mark.parametrize("again", ["check", "shoot"])
def test_what_a_busy_camera_does_not_restore_is_restored_later(again):
    camera, shots = FakeCamera(), []
    session, before = connected(camera, patience=0.1), settings(camera)

    def publish(shot):
        shots.append(shot)
        camera.busy = math.inf
    with pytest.raises(CameraError, match="the camera is busy"):
        session.shoot(publish)
    assert session.connected and settings(camera) != before and camera.lens != 400
    camera.busy = 0
    if again == "check":
        session.check()
    else:
        assert shot_with_warnings(session, shots.append) == []
        assert [round(lens_of(shot.image), -1) for shot in shots[-3:]] == [400, 410, 420]
    assert settings(camera) == before and camera.lens == 400


@pytest.mark.parametrize("call", range(1, 60, 3))
def test_after_any_error_everything_is_as_before(call):
    """Whichever call of a bracket fails: the settings are restored, and the lens is within a step of its start."""
    camera = FakeCamera("Nikon")
    session, before = connected(camera), settings(camera)
    camera.fail = (CAMERA_ERROR, call)
    try:
        session.shoot(lambda shot: None)
    except CameraError:
        pass
    camera.fail = None  # the bracket may have had fewer calls
    session.check()  # the call that failed may have been one of those that restore
    assert settings(camera) == before and abs(camera.lens - 400) <= 100


def test_after_an_interrupted_bracket_the_camera_is_restored_when_it_is_back():
    camera, shots = FakeCamera("Fuji"), []
    session, before = connected(camera), settings(camera)

    def publish(shot):
        shots.append(shot)
        camera.unplug()
    with pytest.raises(CameraError, match="connection to the camera broke") as failure:
        session.shoot(publish)
    assert failure.value.lost and not session.connected and len(shots) == 1
    assert settings(camera) != before
    with pytest.raises(CameraError, match="no camera found: switch it on"):
        session.connect()
    camera.plug()
    session.connect()
    assert session.connected and settings(camera) == before and camera.lens == 400
    assert shot_with_warnings(session, shots.append) == [] and len(shots) == 4


def test_a_frame_is_the_last_if_the_camera_is_lost_on_the_way_to_the_next():
    camera, shots = FakeCamera(), []
    session = connected(camera)
    download = camera.download

    def lost_after(path):
        data = download(path)
        camera.unplug()
        return data
    camera.download = lost_after
    with pytest.raises(CameraError):
        session.shoot(shots.append)
    assert [(shot.count, shot.last) for shot in shots] == [(1, True)]


@pytest.mark.parametrize("code, words", [(USB_CLAIM, "volume monitor (gvfs)"), (MODEL_NOT_FOUND, "no camera found"),
                                         (IO_WRITE, "off, asleep or unplugged"), (BUSY, "busy")])
def test_errors_are_one_line_with_a_remedy(code, words):
    camera = FakeCamera()
    camera.open_errors = [code] * 20
    session = Session(camera, camera_settings(patience=0.1), int)
    with pytest.raises(CameraError) as failure:
        session.connect()
    assert words in str(failure.value) and "\n" not in str(failure.value) and not session.connected


def test_a_camera_that_cannot_be_driven():
    with pytest.raises(CameraError, match="'Pentax K-1'.*only that of Canon EOS, .*use image_folder_camera"):
        connected(FakeCamera("none"))


def test_a_camera_of_another_maker_is_never_driven_as_the_one_before():
    camera = FakeCamera("Canon EOS")
    session = connected(camera)
    camera.make = "Nikon"
    camera.widgets = {name: widget for name, widget in FakeCamera("Nikon").widgets.items() if name != "manualfocusdrive"}
    for _ in range(2):
        with pytest.raises(CameraError, match="no widget manualfocusdrive"):
            session.connect()


def test_calibrated_steps_have_distances():
    camera, shots = FakeCamera("Canon EOS", lens=700), []
    connected(camera, focus_table=TABLE, home="near", first=40, step=10).shoot(shots.append)
    assert [shot.distance for shot in shots] == pytest.approx([1 / 1.2, 1.0, 1 / 0.8])
    assert [round(lens_of(shot.image), -2) for shot in shots] == [400, 500, 600]
    assert camera.lens == 0  # where counting begins


def test_a_focus_table_counts_from_a_stop():
    for home, lens in (("", 0), ("current", 700)):
        camera = FakeCamera("Canon EOS", lens=700)
        connected(camera, focus_table=TABLE, home=home)
        assert camera.lens == lens


def test_a_plan_is_shot_exactly():
    camera, shots = FakeCamera("Nikon", lens=700), []
    session = connected(camera, focus_table=TABLE, home="near", step_size=10)
    session.shoot(shots.append, distances=[0.3, 0.8, 2.0, math.inf])
    assert session.take_warnings() == ["0.30 m lies beyond the focus table: focused at its end"]
    assert [shot.distance for shot in shots] == pytest.approx([0.5, 0.8, 2.0, math.inf], rel=0.01)
    assert [(shot.index, shot.count) for shot in shots] == [(0, 4), (1, 4), (2, 4), (3, 4)]
    for shot, position in zip(shots, (0, 38, 75, 100)):
        assert abs(lens_of(shot.image) - 10 * position) < 4


@pytest.mark.parametrize("wanted, taken", [([1 / 125], 3 * ["1/125"]), ([0.03, 1 / 60, 0.01], ["1/30", "1/60", "1/125"])])
def test_exposure_times_that_are_asked_for(wanted, taken):
    """The nearest that the camera has; afterwards it has its own again."""
    camera, seen = FakeCamera("Nikon"), []
    session, before = connected(camera), settings(camera)
    session.shoot(lambda shot: None, lambda shot: seen.append(camera.widgets["shutterspeed"].value), wanted)
    assert seen == taken and settings(camera) == before and not session.take_warnings()


def test_a_plan_with_an_exposure_time_for_each_distance():
    """Also several times at one distance."""
    camera, seen = FakeCamera("Nikon", lens=700), []
    session = connected(camera, focus_table=TABLE, home="near", step_size=10)

    def released(shot):
        seen.append((camera.lens, camera.widgets["shutterspeed"].value))
    session.shoot(lambda shot: None, released, [1 / 30, 1 / 125, 1 / 125, 1 / 60], [0.8, 0.8, 0.8, 2.0])
    assert seen == [(380, "1/30"), (380, "1/125"), (750, "1/60")]


@pytest.mark.parametrize("change, seconds, words", [
    (lambda widgets: None, [10], "an exposure of 10 s: .*the nearest that it has is 0.0333333 s"),
    (lambda widgets: setattr(widgets["shutterspeed"], "read_only", True), [1 / 60], "no 'shutterspeed' that can be set"),
    (lambda widgets: setattr(widgets["shutterspeed"], "choices", ["Bulb", "x/0"]), [1 / 60], "no 'shutterspeed' that can be")])
def test_exposure_times_that_the_camera_cannot_take(change, seconds, words):
    camera, shots = FakeCamera("Nikon"), []
    session = connected(camera)
    change(camera.widgets)
    before = settings(camera)
    with pytest.raises(CameraError, match=words):
        session.shoot(shots.append, exposures=seconds)
    assert not shots and settings(camera) == before


def lenses(shots):
    return [round(lens_of(shot.image), -1) for shot in shots]


@pytest.mark.parametrize("between_frames", [False, True])
def test_a_hand_pressed_shutter_does_not_shift_the_bracket(between_frames):
    camera, shots = FakeCamera(), []
    session = connected(camera)

    def publish(shot):
        shots.append(shot)
        if between_frames and len(shots) == 1:
            camera.press(902)
    if not between_frames:
        camera.press(902)
    warnings = shot_with_warnings(session, publish)
    assert lenses(shots) == [400, 410, 420]
    name = "IMG_0002.JPG" if between_frames else "IMG_0001.JPG"
    assert warnings == [f"left out {name}: taken by hand, or too late for its frame"]


def test_pictures_taken_by_hand_between_brackets_are_told_once():
    camera, shots = FakeCamera(), []
    session = connected(camera)
    for lens in (100, 200, 300, 500):
        camera.press(lens)
    camera._pending = [(0, event) for _, event in camera._pending]
    session.check()
    assert session.take_warnings() == ["left out IMG_0001.JPG, IMG_0002.JPG, IMG_0003.JPG and 1 more: taken by hand, or "
                                       "too late for its frame"]
    assert shot_with_warnings(session, shots.append) == [] and lenses(shots) == [400, 410, 420]


@pytest.mark.parametrize("delay", [0, 0.015, 0.06])
def test_a_second_card_does_not_shift_the_bracket(delay):
    """Its copy may be reported together with the picture, or only after the next release."""
    camera, shots = FakeCamera(exposure=0.03, raw=True, cards=2, second_card=delay), []
    session = connected(camera, count=4)
    warnings = shot_with_warnings(session, shots.append)
    assert lenses(shots) == [400, 410, 420, 430]
    line, = warnings
    assert line.startswith("left out IMG_0001.JPG, ") and line.endswith(": a copy of a frame on another card")


def test_the_same_name_again_is_a_new_picture():
    """A camera may reuse the number of a picture that was deleted from the card."""
    camera, shots = FakeCamera(), []
    release = camera.capture

    def same_number():
        camera._shots = 0
        release()
    camera.capture = same_number
    assert shot_with_warnings(connected(camera, keep_files=False), shots.append) == []
    assert lenses(shots) == [400, 410, 420]


@pytest.mark.parametrize("make", MAKES)
def test_one_error_leaves_nothing_changed_whichever_call_it_is(make):
    for number in range(1, 100):
        camera = FakeCamera(make)
        session, before = connected(camera), settings(camera)
        camera.fail = (CAMERA_ERROR, number)
        with contextlib.suppress(CameraError):
            session.shoot(lambda frame: None, exposures=(1 / 30, 1 / 60, 1 / 125))
        camera.fail = None
        session.check()
        after = {**settings(camera), "shutterspeed": before["shutterspeed"]}  # in the mode of before the camera chooses it
        assert (after, camera.lens) == (before, 400), number


def test_a_setting_that_cannot_be_set_back_is_told_once():
    camera, shots = FakeCamera(), []
    session = connected(camera)
    camera.refuses.append(("iso", "Auto"))
    line, = shot_with_warnings(session, shots.append)
    assert line.startswith("'iso' was 'Auto' and cannot be set back: set it on the camera (setting 'iso' to Auto: ")
    session.check()
    assert shot_with_warnings(session, shots.append) == []
    assert len(shots) == 6 and settings(camera)["whitebalance"] == "Auto" and camera.lens == 400


def test_a_setting_whose_choices_depend_on_the_mode_is_set_back():
    """ISO 'Auto' is refused in manual mode, which is left last."""
    camera = FakeCamera()
    session, before, set_config = connected(camera), settings(camera), camera.set_config

    def by_mode(name, value):
        if (name, value) == ("iso", "Auto") and camera.widgets["autoexposuremode"].value == "Manual":
            raise CameraError(CAMERA_ERROR, "setting 'iso' to Auto")
        set_config(name, value)
    camera.set_config = by_mode
    assert shot_with_warnings(session, lambda shot: None) == [] and settings(camera) == before


def test_a_lens_that_does_not_go_back_is_told_once():
    camera, shots = FakeCamera("Nikon"), []
    session = connected(camera)
    camera.refuses.append(("manualfocusdrive", -100))
    line, = shot_with_warnings(session, shots.append)
    assert line.startswith("the focus is not back at its start position (setting 'manualfocusdrive' to -100: ")
    session.check()
    assert session.take_warnings() == [] and settings(camera)["iso"] == "Auto"


@pytest.mark.parametrize("make, remedy", [("Nikon", "check the AF/MF switch"), ("none", "turn the focus ring further")])
def test_a_focus_that_did_not_move_is_told(make, remedy):
    camera, shots = FakeCamera(make), []
    camera.texture = "stands still"
    session = connected(camera, drive="none" if make == "none" else "motor")
    line, = shot_with_warnings(session, shots.append)
    assert line.startswith("the focus did not move: the sharpness changed by ") and remedy in line and len(shots) == 3


@pytest.mark.parametrize("frames", [2, 5])
def test_a_focus_that_moves_is_no_warning(frames):
    camera = FakeCamera("Nikon")
    camera.texture = "moves"
    assert shot_with_warnings(connected(camera, count=frames, step_size=150), lambda shot: None) == []


def test_a_ring_that_is_turned_by_hand():
    """The settings hold as with a motor; the camera of any maker will do."""
    camera, shots, held = FakeCamera("none"), [], []
    session = connected(camera, drive="none", step=5, first=7)
    before = settings(camera)

    def publish(shot):
        shots.append(shot)
        held.append(settings(camera))
        camera.lens += 50  # a person turns the ring
    for _ in range(2):
        assert shot_with_warnings(session, publish) == []
    assert lenses(shots) == [400, 450, 500, 550, 600, 650]
    assert [(shot.index, shot.count, shot.last) for shot in shots[:3]] == [(0, 3, False), (1, 3, False), (2, 3, True)]
    assert all(math.isnan(shot.distance) for shot in shots)
    assert {(now["iso"], now["expprogram"]) for now in held} == {("400", "M")} and settings(camera) == before


def test_a_frame_is_told_at_its_release_and_corrected_if_it_becomes_the_last():
    camera, told = FakeCamera("Nikon", lens=LENS - 150), []
    download = camera.download

    def downloaded(path):
        told.append("download")
        return download(path)
    camera.download = downloaded
    connected(camera, count=5).shoot(lambda shot: told.append(("image", shot.stamp, shot.count, shot.last)),
                                     lambda shot: told.append(("release", shot.stamp, shot.count, shot.last)))
    assert told == [("release", 0, 5, False), "download", ("image", 0, 5, False),
                    ("release", 1, 5, False), "download", ("image", 1, 2, True)]
