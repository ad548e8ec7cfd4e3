# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the camera nodes: what is impossible is named in one line."""
import pytest
import rospy

from all_in_focus import parameters
from all_in_focus.camera.bracket_node import PARAMETERS, check
from all_in_focus.files.rig import Camera


@pytest.fixture
def given(monkeypatch):
    """Private parameters as if a master held them."""
    values = {}
    monkeypatch.setattr(rospy, "get_param", lambda name, default: values.get(name.lstrip("~"), default))
    return values


def read_settings():
    settings = parameters.read(PARAMETERS)
    check(settings)
    return settings


def test_defaults(given):
    assert vars(read_settings()) == {name: one.default for name, one in PARAMETERS.items()}


@pytest.mark.parametrize("name, value, words", [
    ("count", 0, "~count: expected a whole number of at least 1, not '0'"),
    ("count", 2.5, "~count: expected a whole number of at least 1, not '2.5'"),
    ("count", "many", "~count: expected a whole number of at least 1, not 'many'"),
    ("count", True, "~count: expected a whole number"),
    ("drive", "ring", "~drive: 'ring' is not one of motor, none"),
    ("step", 0, "~step: 0 would take the same picture 9 times"),
    ("frames", "film", "~frames: 'film' is not one of still, preview"),
    ("maker", "Leica", "~maker: 'Leica' is not one of Canon EOS, Nikon"),
    ("home", "far away", "~home: 'far away' is not one of current, near, far"),
    ("timeout", float("inf"), "~timeout: expected a number"),
    ("timeout", float("nan"), "~timeout: expected a number"),
    ("keep_files", 1, "~keep_files: expected true or false, not '1'"),
    ("white_balance", True, "~white_balance: expected text, not True: write it in quotes"),
    ("iso", [100], "~iso: expected text, not [100]"),
    ("focus_table", "", "~focus_table: expected a list, not ''"),
    ("focus_table", 0, "~focus_table: expected a list, not '0'")])
def test_impossible_parameters_are_named(given, name, value, words):
    given[name] = value
    with pytest.raises(ValueError) as failure:
        read_settings()
    assert str(failure.value).startswith(words)


def test_text_that_means_a_number_is_taken_as_that(given, monkeypatch):
    said = []
    monkeypatch.setattr(rospy, "logwarn", lambda line, *values: said.append(line % values))
    given.update(count="5", settle="0.5", keep_files="true", iso=100)
    config = read_settings()
    assert (config.count, config.settle, config.keep_files, config.iso) == (5, 0.5, True, "100")
    assert said == ["count is text: '5' is taken as 5; write it without quotes",
                    "settle is text: '0.5' is taken as 0.5; write it without quotes",
                    "keep_files is text: 'true' is taken as true; write it without quotes"]


def test_a_ring_turned_by_hand_has_no_focus_distances(given):
    given.update(drive="none", step=0)
    assert read_settings().drive == "none"
    given["focus_table"] = [{"step": 0, "mm": 500}]
    with pytest.raises(ValueError, match="~drive: none takes neither ~focus_table nor ~home"):
        read_settings()


def test_a_calibration_for_another_size_sees_the_same():
    camera = Camera("color", 640, 480, [[800, 0, 319.5], [0, 810, 239.5], [0, 0, 1]])
    half = camera.scaled(320, 240)
    assert (half.width, half.height) == (320, 240)
    # The middle of the picture stays the middle: pixel 159.5 of 320, as 319.5 of 640.
    assert half.K.tolist() == [[400, 0, 159.5], [0, 405, 119.5], [0, 0, 1]]
    assert half.P[:, :3].tolist() == half.K.tolist()
