# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Brackets through libgphoto2's real PTP driver and its virtual camera; run by scripts/try_virtual_camera.

The virtual camera has no focus drive and gives a copy of the same picture for each release, at most 26 times in a process.
PTP operation 0x9999 makes it report a picture that nobody released from here: the hand-pressed shutter.
"""
import contextlib
import itertools
import os
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

if "VIRTUAL_CARD" not in os.environ:
    pytest.skip("is run by scripts/try_virtual_camera", allow_module_level=True)

from all_in_focus.camera.gphoto import GphotoCamera  # noqa: E402
from all_in_focus.camera.session import Session  # noqa: E402
from fake_camera import camera_settings  # noqa: E402

HERE = Path(__file__).resolve().parent
CARD = Path(os.environ["VIRTUAL_CARD"])


@pytest.fixture(scope="module")
def picture():
    """The picture on the card."""
    folder = CARD / "DCIM" / "100GPHOT"
    folder.mkdir(parents=True, exist_ok=True)
    texture = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 255, (400, 600, 3)).astype(np.uint8), (0, 0), 2)
    cv2.imwrite(str(folder / "GPH_0001.jpg"), texture)
    return cv2.imread(str(folder / "GPH_0001.jpg"))


@pytest.fixture(scope="module")
def session(picture):
    camera = GphotoCamera()
    session = Session(camera, camera_settings(drive="none", count=3, settle=0, timeout=5), itertools.count().__next__)
    session.connect()
    session.camera = camera
    yield session
    session.close()


@pytest.fixture(autouse=True)
def no_warnings_left(request):
    yield
    if "session" in request.fixturenames:
        request.getfixturevalue("session").take_warnings()


def downloaded(session):
    """Names of the files that brackets download from now on."""
    names, download = [], session.camera.download

    def noted(path):
        names.append(path.rsplit("/", 1)[1])
        return download(path)
    session.camera.download = noted
    return names


def press(camera, delay_ms):
    """Somebody presses the shutter; the camera reports the picture after this time."""
    camera.set_config("opcode", f"0x9999,0x0,{delay_ms:#x}")


def number_of(name):
    return int(name[4:8])


def test_it_is_a_nikon(session):
    assert session.description == "Nikon DSC D750, focused by hand"


def test_settings_are_read_and_set(session):
    speed = session.camera.get_config("shutterspeed")
    assert speed.value in speed.choices and len(speed.choices) > 5
    other = next(choice for choice in speed.choices if choice != speed.value)
    session.camera.set_config("shutterspeed", other)
    assert session.camera.get_config("shutterspeed").value == other
    session.camera.set_config("shutterspeed", speed.value)


def test_a_bracket(session, picture):
    shots, order = [], []

    def publish(shot):
        shots.append(shot)
        order.append(("image", shot.stamp))
    held = session.camera.get_config("autofocus").value
    session.shoot(publish, lambda shot: order.append(("release", shot.stamp)))
    assert [(shot.index, shot.count, shot.last) for shot in shots] == [(0, 3, False), (1, 3, False), (2, 3, True)]
    assert order == [(what, stamp) for stamp in range(3) for what in ("release", "image")]
    for shot in shots:
        np.testing.assert_array_equal(shot.image, picture)
    assert session.camera.get_config("autofocus").value == held


def test_a_bracket_of_exposure_times(session):
    camera, seen = session.camera, []
    speed = camera.get_config("shutterspeed")
    wanted = speed.choices[1:4]  # such as 0.0012s
    session.shoot(lambda shot: None, lambda shot: seen.append(camera.get_config("shutterspeed").value),
                  [1.1 * float(choice.rstrip("s")) for choice in wanted])
    assert seen == wanted and camera.get_config("shutterspeed").value == speed.value
    session.take_warnings()


def test_the_same_picture_again_is_a_focus_that_did_not_move(session):
    session.shoot(lambda shot: None)
    line, = session.take_warnings()
    assert line.startswith("the focus did not move: the sharpness changed by 0 % at most over 3 frames")


def test_pictures_taken_by_hand_do_not_shift_the_bracket(session):
    """One lies in the event queue before the bracket, one comes between the first two frames."""
    names, shots = downloaded(session), []

    def publish(shot):
        shots.append(shot)
        if len(shots) == 1:
            press(session.camera, 1)
    press(session.camera, 1)
    time.sleep(0.1)
    session.shoot(publish)
    left_out = [line for line in session.take_warnings() if line.startswith("left out ")]
    assert left_out == ["left out GPH_0098.JPG, GPH_0099.JPG: taken by hand, or too late for its frame"]
    # The virtual camera counts its own releases apart from those by hand, by two.
    numbers = [number_of(name) for name in names]
    assert len(names) == 3 and np.diff(numbers).tolist() == [2, 2] and numbers[0] > 99


def test_a_picture_taken_by_hand_between_brackets_is_told(session):
    press(session.camera, 1)
    time.sleep(0.1)
    session.check()
    line, = session.take_warnings()
    assert line == "left out GPH_0100.JPG: taken by hand, or too late for its frame"


def test_events_come_in_order_and_the_queue_gets_empty(session):
    camera = session.camera
    press(camera, 300)
    camera.capture()
    files, end = [], time.monotonic() + 10
    while len(files) < 2 and time.monotonic() < end:
        files += filter(None, [camera.wait_for_event(0.5)])
    assert len(files) == 2 and "GPH_0101.JPG" in files[1]
    while camera.wait_for_event(0.02) is not None:
        pass


def test_a_setting_that_the_driver_refuses_to_take_back_is_told_once(session):
    """As after a changed lens or mode: the value of before is no longer there."""
    session._hold._set("shutterspeed", session.camera.get_config("shutterspeed").value, "Auto")
    session.check()
    line, = session.take_warnings()
    assert line.startswith("'shutterspeed' was 'Auto' and cannot be set back: set it on the camera (setting ")
    session.check()
    assert session.take_warnings() == []
    shots = []
    session.shoot(shots.append)
    assert len(shots) == 3


def test_keep_files_false_deletes_from_the_card(session):
    camera = session.camera
    camera.capture()
    path = ""
    while not path:
        path = camera.wait_for_event(0.5)
    camera.delete(path)
    with pytest.raises(Exception, match="downloading "):
        camera.download(path)


def test_the_node(picture):
    """focus_bracket_camera as a program: bracket by service, focus at the shutter, then the picture with its stamp."""
    sys.path[:0] = [str(HERE / "ros"), str(HERE.parent / "bench")]
    import ros_run
    import rospy
    from camera_testing import TOPICS, NodeProcess, wait_until
    from depth_testing import pixels_of
    from file_helpers import SCRIPTS
    from std_srvs.srv import Trigger
    with contextlib.ExitStack() as stack:
        stack.enter_context(ros_run.Ros())
        rospy.init_node("virtual_camera", disable_signals=True)
        stack.callback(rospy.signal_shutdown, "done")
        heard = {name: [] for name in TOPICS}
        for name, kind in TOPICS.items():
            rospy.Subscriber("/virtual/" + name, kind, lambda message, name=name: heard[name].append(
                (message, time.monotonic())))
        node = NodeProcess(SCRIPTS / "focus_bracket_camera", "/virtual", drive="none", count=4, settle=0.2)
        stack.callback(node.stop)
        assert node.said("ready: Nikon DSC D750, focused by hand"), node.lines
        service = rospy.ServiceProxy("/virtual/focus_bracket_camera/bracket", Trigger)
        service.wait_for_service(10)
        answer = service()
        assert answer.success and answer.message.startswith("4 frames; the focus did not move"), answer.message
        assert wait_until(lambda: len(heard["rgb/image"]) == 4 and len(heard["rgb/focus"]) == 4)
        for (image, image_time), (focus, focus_time) in zip(heard["rgb/image"], heard["rgb/focus"]):
            assert image.header.stamp == focus.header.stamp and focus_time < image_time
            np.testing.assert_array_equal(pixels_of(image), picture)
        assert [(focus.index, focus.count, focus.last) for focus, _ in heard["rgb/focus"]] \
            == [(index, 4, index == 3) for index in range(4)]
