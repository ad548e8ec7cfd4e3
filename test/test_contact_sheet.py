# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Contact sheets."""
import cv2
import numpy as np

from all_in_focus import imaging
from file_helpers import call, run_script
from tool_helpers import expect_refusal, succeeded


def test_contact_sheet(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((30, 60, 3), (10, 20, 30), np.uint8))
    labels = np.full((30, 60), 1, np.uint16)
    labels[:, 20:40], labels[:, 40:] = 2, 0
    cv2.imwrite(str(tmp_path / "labels.png"), labels)
    sheet = tmp_path / "sheet.png"
    succeeded(run_script("contact_sheet", "--output", sheet, "--columns", 2, "--width", 60, tmp_path / "a.png",
                         f"{tmp_path / 'labels.png'}:seven regions", tmp_path / "a.png"))
    image = cv2.imread(str(sheet))
    assert image.shape == (2 * (30 + 24) + 18, 2 * 66 + 6, 3)
    assert (image[40, 20] == (10, 20, 30)).all() and (image[40, 6 + 66 + 50] == 0).all()
    assert (image[40, 6 + 66 + 5] != image[40, 6 + 66 + 30]).any()
    assert (image[6:30, 6:66] < 128).any()  # a title
    for bad in (["none.png"], [str(tmp_path / "a.png"), "--columns", "0"]):
        expect_refusal(call("contact_sheet", "--output", tmp_path / "no.png", *bad), "contact_sheet")
        assert not (tmp_path / "no.png").exists()


def test_near_is_red_and_depth_has_a_legend():
    depth = np.full((300, 600), 1000, np.uint16)
    depth[:, 200:400], depth[:, 400:] = 4000, 0
    shown = imaging.picture(depth)
    assert shown.shape[0] > 300 and shown.shape[1:] == (600, 3)
    assert [shown[9, x].argmax() for x in (0, 300)] == [2, 0] and not shown[9, 500].any()  # BGR: red, blue, black
    legend = shown[300:]
    row = legend[legend.shape[0] // 4]
    assert row[0].argmax() == 2 and row[-1].argmax() == 0
    middle = imaging.depth_picture(np.array([[1000, 1600, 4000]], np.uint16))[0, 1]  # half way in dioptres
    assert np.abs(row[300].astype(int) - middle).max() < 10
    assert (legend[legend.shape[0] // 2:] < 128).any()  # metres


def test_regions_are_red_where_they_are_near():
    labels = np.repeat(np.arange(4, dtype=np.uint16)[None], 200, axis=0).repeat(100, axis=1)
    shown = imaging.picture(labels)
    assert shown.shape == (200, 400, 3) and not shown[0, 0].any()
    assert [shown[0, x].argmax() for x in (100, 200, 300)] == [2, 1, 0]


def test_source_index_shows_its_first_frame():
    index = np.array([[0, 5, imaging.NO_FRAME]], np.uint16)
    shown = imaging.picture(index, zero_is_unknown=False)
    assert shown[0, 0].any() and not shown[0, 2].any() and (shown[0, 0] != shown[0, 1]).any()
    assert not imaging.picture(index)[0, 0].any()
    assert imaging.split_title("x/y.png:a title") == ("x/y.png", "a title")
    assert imaging.split_title("x/y.png") == ("x/y.png", "y.png")
