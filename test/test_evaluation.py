# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluation runs without a ROS master: results on disk, exit codes, ending what was started."""
import contextlib
import json
import os
import sys
from concurrent.futures import ThreadPoolExecutor

import cv2
import genpy
import numpy as np
import pytest
from std_msgs.msg import Header

from all_in_focus.acknowledgements import Acknowledgements
from all_in_focus.bag import bag_file
from all_in_focus.replay import player as bag_player, results
from all_in_focus.msg import FusionReport, Optics, Segment, SegmentArray, SegmentChoice
from all_in_focus.files.output_file import encode_png
from all_in_focus.files.output_folder import MARK
from all_in_focus.replay.evaluation import conclude
from all_in_focus.replay.results import ResultFolder, encode_labels, to_plain
import bag_helpers
from file_helpers import call, file_limit, run_script
from tool_helpers import expect_refusal


# ---- results


def report_message(stamp=7, used=3, has_labels=True, sharpness_alone=False):
    choice = SegmentChoice(label=1, frame=2, score=float("nan"), margin=0.5, confidence=0.25)
    return FusionReport(header=Header(seq=9, stamp=genpy.Time(stamp, 500000000), frame_id="color_frame"), bracket_id=4,
                        mode="refined", sharpness_alone=sharpness_alone, frames_seen=3, frames_used=used,
                        has_labels=has_labels, label_stamp=genpy.Time(5), optics=Optics(24.0, 4.0, 0.019),
                        segments=[choice] if has_labels else [],
                        notes=[] if used else ["no frame could be used"], timing_names=["fusion"], timing_ms=[1.5])


def segments_message():
    return SegmentArray(dof_rule="paper", unknown_area=11, segments=[Segment(label=1, area=9, max_dof=float("inf"))])


def test_report_mirrors_the_message():
    plain = results.report_dict(report_message(), to_plain(segments_message()))
    assert plain["version"] == 1 and plain["header"] == {"stamp": 7.5, "frame_id": "color_frame"}
    assert set(plain) == set(FusionReport.__slots__) | {"version", "dof_rule", "unknown_area", "segment_table"}
    assert plain["label_stamp"] == 5.0 and plain["optics"]["aperture"] == 4.0
    assert plain["segments"][0] == {"label": 1, "frame": 2, "score": None, "margin": 0.5, "confidence": 0.25}
    assert set(plain["segment_table"][0]) == set(Segment.__slots__) and plain["segment_table"][0]["max_dof"] is None
    assert results.report_dict(report_message(has_labels=False))["label_stamp"] is None
    json.dumps(plain, allow_nan=False)


def test_labels_are_16_bit():
    labels = np.array([[0, 1], [300, 65535]], np.int32)
    read = cv2.imdecode(np.frombuffer(encode_labels(labels), np.uint8), cv2.IMREAD_UNCHANGED)
    assert read.dtype == np.uint16 and np.array_equal(read, labels)
    with pytest.raises(ValueError, match="65536 regions"):
        encode_labels(labels + 1)


PNG = encode_png(np.zeros((2, 2), np.uint8))
PICTURES = ("fused", "registered", "source_index", "confidence", "weights")


def feed(folder, stamp=genpy.Time(7, 500000000), names=None):
    for name in names or (*PICTURES, "labels", "regions"):
        folder.add(name, genpy.Time(5) if name in ("labels", "regions") else stamp, PNG)
    if names is None:
        folder.add("segments", genpy.Time(5), json.dumps(to_plain(segments_message())).encode())


@contextlib.contextmanager
def collecting(path):
    """A ResultFolder, whose results are there at the end."""
    folder = ResultFolder(str(path))
    yield folder
    folder.commit()
    folder.discard()


@pytest.mark.parametrize("report_first", [True, False])
def test_bracket_is_saved_when_complete(tmp_path, report_first):
    with collecting(tmp_path / "out") as folder:
        folder.add("labels", genpy.Time(4), PNG)  # of an earlier depth image
        if report_first:
            folder.reports.append(report_message())
            assert folder.missing()
        feed(folder)
        if not report_first:
            folder.reports.append(report_message())
        assert not folder.missing() and not (tmp_path / "out" / "bracket_0000").exists()
    assert sorted(os.listdir(tmp_path / "out")) == [MARK, "bracket_0000"]
    assert sorted(os.listdir(tmp_path / "out" / "bracket_0000")) == [
        "confidence.png", "fused.png", "labels.png", "regions.png", "registered.png", "report.json",
        "source_index.png", "weights.png"]
    report = json.loads((tmp_path / "out" / "bracket_0000" / "report.json").read_text())
    assert report["bracket_id"] == 4 and report["segment_table"][0]["area"] == 9
    assert [report.bracket_id for report in folder.reports] == [4]


def test_two_brackets_may_share_a_label_image(tmp_path):
    with collecting(tmp_path) as folder:
        feed(folder)
        folder.reports.append(report_message())
        feed(folder, genpy.Time(9, 500000000), names=PICTURES)
        folder.reports.append(report_message(stamp=9))
    assert sorted(os.listdir(tmp_path)) == [MARK, "bracket_0000", "bracket_0001"]


def test_bracket_without_labels_or_without_result(tmp_path):
    with collecting(tmp_path) as folder:
        folder.reports.append(report_message(used=0))
        folder.reports.append(report_message(stamp=8, has_labels=False, sharpness_alone=True))
        feed(folder, genpy.Time(8, 500000000), names=[name for name in PICTURES if name != "registered"])
        folder.reports.append(report_message(stamp=9, has_labels=False))  # of large images depth stays, labels do not
        feed(folder, genpy.Time(9, 500000000), names=PICTURES)
    assert os.listdir(tmp_path / "bracket_0000") == ["report.json"]
    assert len(os.listdir(tmp_path / "bracket_0001")) == 5 and len(os.listdir(tmp_path / "bracket_0002")) == 6
    assert (tmp_path / "bracket_0002" / "registered.png").exists()
    with pytest.raises(ValueError, match="^no region came of the bag's depth$"):
        conclude(folder.reports[1:2], {}, [])
    assert conclude(folder.reports[2:], {}, []) == "1 bracket fused"


def test_missing_output_is_reported(tmp_path):
    folder = ResultFolder(str(tmp_path / "one"))
    folder.reports.append(report_message())
    feed(folder, names=PICTURES)
    assert folder.missing() == {0: ["segmentation/labels", "segmentation/image_color", "segmentation/segments"]}
    folder.discard()

    assert not os.listdir(tmp_path)


WITHOUT_DEPTH = ("confidence", "fused", "source_index", "weights")


def add_bracket(folder):
    stamp = 7 + len(folder.reports)
    folder.reports.append(report_message(stamp, has_labels=False, sharpness_alone=True))
    feed(folder, genpy.Time(stamp, 500000000), WITHOUT_DEPTH)


def test_old_results_stay_until_the_new_are_complete(tmp_path):
    out = tmp_path / "out"
    folder = ResultFolder(str(out))
    for _ in range(3):
        add_bracket(folder)
    folder.commit()
    folder.discard()
    (out / "mine").mkdir()
    folder = ResultFolder(str(out))
    add_bracket(folder)
    folder.discard()
    assert sorted(os.listdir(out)) == [MARK, "bracket_0000", "bracket_0001", "bracket_0002", "mine"]
    assert (out / "bracket_0002" / "fused.png").exists()
    folder = ResultFolder(str(out))
    add_bracket(folder)
    add_bracket(folder)
    folder.commit()
    folder.discard()
    assert sorted(os.listdir(out)) == [MARK, "bracket_0000", "bracket_0001", "mine"]
    assert sorted(os.listdir(out / "bracket_0001")) == sorted([*(f"{name}.png" for name in WITHOUT_DEPTH), "report.json"])
    new = tmp_path / "new"
    ResultFolder(str(new)).discard()
    assert not new.exists() and os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("name", ["bracket_0000", "bracket_12345"])
def test_brackets_of_others_are_not_touched(tmp_path, name):
    """Such as those of bag_to_stack --bracket all, or of a user."""
    (tmp_path / "out" / name).mkdir(parents=True)
    (tmp_path / "out" / name / "mine.png").write_bytes(PNG)
    with pytest.raises(FileExistsError, match="was not written by evaluate_bag"):
        ResultFolder(str(tmp_path / "out"))
    assert (tmp_path / "out" / name / "mine.png").exists() and os.listdir(tmp_path) == ["out"]


# ---- what is said, flow


def bracket(used=3, has_depth=True):
    return report_message(used=used, has_labels=has_depth, sharpness_alone=not has_depth)


@pytest.mark.parametrize("reports, summary", [
    ([bracket()], "1 bracket fused"), ([bracket(), bracket()], "2 brackets fused"),
    ([bracket(), bracket(has_depth=False)], "2 brackets fused"), ([bracket(), bracket(0)], "1 bracket fused, 1 could not be")])
def test_conclusion(reports, summary):
    assert conclude(reports, {}, ["a warning"]) == summary


@pytest.mark.parametrize("reports, missing, reason", [
    ([bracket(has_depth=False)], {}, "no region came of the bag's depth: a warning"),
    ([], {}, "no bracket was fused: a warning"), ([bracket(0)], {}, "no bracket was fused: no frame could be used"),
    ([bracket()], {0: ["all_in_focus/image"]}, "bracket_0000: all_in_focus/image never came")])
def test_why_there_is_no_result(reports, missing, reason):
    with pytest.raises(ValueError, match=f"^{reason}$"):
        conclude(reports, missing, ["a warning"])


def test_evaluate_bag_refuses_bad_input_in_one_line(tmp_path):
    (tmp_path / "text.bag").write_text("no")
    for bag_name, more, complaint in (("none.bag", [], "No such file"), ("text.bag", [], "not a bag"),
                                      ("text.bag", ["--mode", "best"], "invalid choice"),
                                      ("text.bag", ["--optics", "1,2"], "f,F,coc")):
        done = call("evaluate_bag", "--bag", tmp_path / bag_name, "--output", tmp_path / "out", *more)
        expect_refusal(done, "evaluate_bag", complaint)
    assert not (tmp_path / "out").exists()


def test_evaluate_bag_says_that_there_is_no_room_for_what_nodes_print(tmp_path):
    bag_helpers.write(tmp_path / "x.bag", bag_helpers.good_messages())
    done = run_script("evaluate_bag", "--bag", tmp_path / "x.bag", "--output", tmp_path / "out", restore_signals=False,
                      preexec_fn=file_limit(512))
    expect_refusal(done, "evaluate_bag", "/room: File too large")


def test_acknowledgements():
    def header(stamp):
        return Header(stamp=genpy.Time(nsecs=stamp))
    under_way = Acknowledgements()
    for stamp in (5, 3, 3):
        under_way.sent(header(stamp))
    under_way.came(header(99))
    assert under_way.under_way() == 3 and under_way.received == 1
    under_way.came(header(3))
    assert under_way.under_way() == 2 and under_way.first() == 3
    under_way.give_up()
    assert under_way.under_way() == 0 and under_way.first() is None
    under_way.sent(header(5))
    under_way.peer_subscribe("rgb/image", None, None)  # a node that listens anew knows nothing of it
    assert under_way.under_way() == 0


def test_acknowledgements_come_while_frames_are_sent():
    headers, under_way = [Header(stamp=genpy.Time(nsecs=stamp)) for stamp in range(2000)], Acknowledgements()
    for header in headers[::2]:
        under_way.sent(header)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # threads take turns in the middle of all that is not locked
    try:
        with ThreadPoolExecutor() as threads:
            results_of = [threads.map(under_way.came, headers[::2]), threads.map(under_way.sent, headers[1::2])]
            assert [len(list(each)) for each in results_of] == [1000, 1000]
    finally:
        sys.setswitchinterval(interval)
    assert under_way.under_way() == 1000 and under_way.first() == 1


def test_every_kind_of_the_bag_is_known():
    assert set(bag_file.TYPES) == set(vars(bag_file.Topics()))
    assert set(bag_player.TOPICS) < set(bag_file.TYPES)
