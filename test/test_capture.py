# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which bracket a goal of the action gets, where brackets come by themselves. With a graph: ros/robot_capture_test.py."""
import threading
from types import SimpleNamespace

import pytest
from actionlib_msgs.msg import GoalStatus

from all_in_focus.camera import capture_node
from all_in_focus.msg import CaptureGoal, FocusFrame, FusionReport, Progress

HANDLE = SimpleNamespace(get_goal=CaptureGoal, publish_feedback=lambda feedback: None,
                         get_goal_status=lambda: SimpleNamespace(status=GoalStatus.ACTIVE))


def play(work, bracket_id, sharpness_alone):
    """A bracket of two frames and its result."""
    for index in (0, 1):
        work._on_progress(Progress(frame=FocusFrame(bracket_id=bracket_id, index=index, count=2)))
    report = FusionReport(bracket_id=bracket_id, sharpness_alone=sharpness_alone, frames_used=2)
    work._on_progress(Progress(is_result=1, report=report))


def result_of(monkeypatch, work, patience):
    monkeypatch.setattr(capture_node, 'DEPTH_PATIENCE', patience)
    work.await_depth_from_now()
    threads = [threading.Timer(0.05, play, (work, 1, True)), threading.Timer(0.1, work._has_depth.set),
               threading.Timer(0.15, play, (work, 2, False))]
    for thread in threads:
        thread.start()
    result = work._result(has_camera=False, timeout=10)
    for thread in threads:
        thread.join()
    return result.report.bracket_id


@pytest.mark.parametrize('patience, bracket', [(5, 2), (0.0, 1)])
def test_a_bracket_before_any_depth_gives_way_to_the_next(monkeypatch, patience, bracket):
    """But not when depth is not waited for any longer."""
    assert result_of(monkeypatch, capture_node._Work(HANDLE), patience) == bracket


def test_a_bracket_before_any_depth_counts_where_no_other_comes(monkeypatch):
    monkeypatch.setattr(capture_node, 'DEPTH_PATIENCE', 0.3)
    work = capture_node._Work(HANDLE)
    work.await_depth_from_now()
    play(work, 1, True)
    work._has_depth.set()
    assert work._result(has_camera=False, timeout=10).report.bracket_id == 1
