# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How the node of a folder waits for the fusion."""
import threading
from types import SimpleNamespace

import pytest
import rospy

from all_in_focus.camera import folder_node
from all_in_focus.camera.folder_node import MAX_UNPROCESSED, FlowControl


@pytest.fixture
def flow(monkeypatch):
    monkeypatch.setattr(rospy, "Subscriber", lambda *_: SimpleNamespace(get_num_connections=lambda: 1))
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    return FlowControl()


class SlowList(list):
    """After it was iterated over, `meanwhile` gets 0.2 s to run in another thread."""

    def __init__(self, items, meanwhile):
        super().__init__(items)
        self.thread = threading.Thread(target=meanwhile)

    def __iter__(self):
        yield from tuple(super().__iter__())
        self.thread.start()
        self.thread.join(0.2)


def test_a_frame_that_is_published_during_an_acknowledgement_counts(flow):
    flow._unprocessed = unprocessed = SlowList([1], lambda: flow.published(2))
    flow._on_processed(SimpleNamespace(stamp=0))
    unprocessed.thread.join()
    assert flow._unprocessed == [1, 2]


def expect_wait_for(acknowledged, flow, new_bracket):
    waiting = threading.Thread(target=flow.wait, args=(lambda: True, new_bracket))
    waiting.start()
    waiting.join(0.3)
    assert waiting.is_alive()
    flow._on_processed(SimpleNamespace(stamp=acknowledged))
    waiting.join()


def test_it_waits_until_frames_are_acknowledged(flow):
    for stamp in range(MAX_UNPROCESSED):
        flow.published(stamp)
    expect_wait_for(0, flow, new_bracket=False)
    assert flow._unprocessed == list(range(1, MAX_UNPROCESSED))


def test_a_bracket_waits_for_the_result_of_the_one_before(flow, monkeypatch):
    flow.published(0)
    flow.wait(lambda: True, new_bracket=False)
    monkeypatch.setattr(folder_node, "ACKNOWLEDGE_TIMEOUT", 0.0)  # restoring takes longer than a frame
    expect_wait_for(0, flow, new_bracket=True)


def test_it_does_not_wait_for_a_fusion_that_has_left(flow):
    flow.published(0)
    flow.wait(lambda: False, new_bracket=True)
    assert flow._unprocessed == []


def test_it_does_not_wait_for_what_was_published_before_the_fusion_came_back(flow):
    flow.published(0)
    waiting = threading.Thread(target=flow.wait, args=(lambda: True, True))
    waiting.start()
    flow.forget()
    waiting.join()
    assert flow._unprocessed == []
