# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How the node of a folder waits for the fusion."""
import threading
from types import SimpleNamespace

import cv2
import genpy
import numpy as np
import pytest
import rospy
from std_msgs.msg import Header

from all_in_focus.camera import folder_node
from all_in_focus.camera.folder_node import MAX_UNPROCESSED, Player


@pytest.fixture
def player(monkeypatch, tmp_path):
    monkeypatch.setattr(rospy, "Subscriber", lambda *_: SimpleNamespace(get_num_connections=lambda: 1))
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((4, 4, 3), np.uint8))
    return Player(SimpleNamespace(stack=str(tmp_path), focus=""))


def header(stamp):
    return Header(stamp=genpy.Time(stamp))


def waiting_for(player, new_bracket):
    waiting = threading.Thread(target=player.await_fusion, args=(lambda: True, new_bracket))
    waiting.start()
    waiting.join(0.3)
    assert waiting.is_alive()
    return waiting


def test_it_waits_until_frames_are_acknowledged(player):
    for stamp in range(MAX_UNPROCESSED):
        player.flow.sent(header(stamp))
    waiting = waiting_for(player, new_bracket=False)
    player.flow.came(header(0))
    waiting.join()
    assert player.flow.under_way() == MAX_UNPROCESSED - 1


def test_a_bracket_waits_for_the_result_of_the_one_before(player, monkeypatch):
    player.flow.sent(header(0))
    player.await_fusion(lambda: True, new_bracket=False)
    monkeypatch.setattr(folder_node, "ACKNOWLEDGE_TIMEOUT", 0.0)  # restoring takes longer than a frame
    waiting = waiting_for(player, new_bracket=True)
    player.flow.came(header(0))
    waiting.join()


def test_it_does_not_wait_for_a_fusion_that_has_left(player):
    player.flow.sent(header(0))
    player.await_fusion(lambda: False, new_bracket=True)
    assert player.flow.under_way() == 0


def test_it_does_not_wait_for_what_was_published_before_the_fusion_came_back(player):
    player.flow.sent(header(0))
    waiting = waiting_for(player, new_bracket=True)
    player.flow.give_up()
    waiting.join()
