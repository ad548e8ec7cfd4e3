#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""focus_bracket_camera with a fake camera: ~make, ~lens, ~claimed (times it cannot be opened at first),
~exposure (s until a picture arrives).

The topic ~provoke (std_msgs/String) takes "unplug", "plug", "press LENS", "develop" (pictures arrive at once), "busy N" and
"fail CODE N" (the Nth call from then on fails).
"""
import sys
from pathlib import Path

import rospy
from std_msgs.msg import String

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from all_in_focus.camera.bracket_node import PARAMETERS, shoot  # noqa: E402
from all_in_focus.camera.interface import USB_CLAIM  # noqa: E402
from all_in_focus.command_line import node, run  # noqa: E402
from fake_camera import FakeCamera  # noqa: E402


def camera_at(_port, _model):
    camera = FakeCamera(rospy.get_param("~make", "Canon EOS"), rospy.get_param("~lens", 400), latency=0.001,
                        exposure=rospy.get_param("~exposure", 0.01))
    camera.open_errors = [USB_CLAIM] * rospy.get_param("~claimed", 0)

    def provoke(message):
        words = message.data.split()
        if words[0] == "busy":
            camera.busy = int(words[1])
        elif words[0] == "press":
            camera.press(int(words[1]))
        elif words[0] == "fail":
            camera.fail = tuple(map(int, words[1:]))
        else:
            getattr(camera, words[0])()
    rospy.Subscriber("~provoke", String, provoke)
    return camera


if __name__ == "__main__":
    run(node("focus_bracket_camera", __doc__, lambda settings: shoot(settings, camera_at), PARAMETERS))
