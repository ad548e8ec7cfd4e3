# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_focus --live: one bracket of the running cameras, and the registered depth of its beginning."""
import threading
import time

import message_filters
import rospy
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from all_in_focus.calibration.focus_curve import Sharpness, dioptres_of_registered
from all_in_focus.image_messages import BRIDGE, bgr
from all_in_focus.msg import FocusFrame

CAMERA = "focus_bracket_camera"
QUEUE = 100  # frames
NO_CAMERA = 2.0  # s without the camera's service: the next bracket of whatever camera is taken


class _Bracket:
    """Collects a bracket from its first frame on. Callbacks are called by one synchroniser and one subscriber."""

    def __init__(self):
        self.sharpness, self.depth, self.problem = Sharpness(), None, ""
        self.done = threading.Event()
        self._id = None
        self._depth = rospy.Subscriber("depth_registered/image_raw", Image, self._on_depth, queue_size=1, buff_size=2 ** 26)
        frames = [message_filters.Subscriber("rgb/image", Image, queue_size=QUEUE, buff_size=2 ** 26),
                  message_filters.Subscriber("rgb/focus", FocusFrame, queue_size=QUEUE)]
        self._synchronizer = message_filters.TimeSynchronizer(frames, QUEUE)
        self._synchronizer.registerCallback(self._on_frame)

    def _on_depth(self, message):
        if self._id is None:
            self.depth = BRIDGE.imgmsg_to_cv2(message, "16UC1")

    def _on_frame(self, image, focus):
        if self.done.is_set() or self.depth is None:
            return
        if focus.index == 0:
            self._id, self.sharpness = focus.bracket_id, Sharpness()
        if focus.bracket_id != self._id:
            return
        if focus.index != len(self.sharpness.frames):
            self.problem = f"frame {len(self.sharpness.frames)} of the bracket never came"
            return self.done.set()
        try:
            self.sharpness.add(bgr(image))
        except ValueError as error:
            self.problem = str(error)
        if focus.last or self.problem:
            self.done.set()


def shoot(timeout):
    """(Sharpness, dioptres of its tiles, home, first, step); the last three as focus_bracket_camera has them."""
    rospy.init_node("calibrate_focus", anonymous=True, disable_signals=True)
    bracket = _Bracket()
    end = time.monotonic() + timeout
    rospy.loginfo("waiting for depth on %s", rospy.resolve_name("depth_registered/image_raw"))
    _wait(lambda: bracket.depth is not None, end, "no depth came on depth_registered/image_raw: is robot.launch running, "
                                                  "with a rig?")
    asked = _ask_for_bracket(bracket)
    rospy.loginfo("asked %s for a bracket" if asked else "waiting for the next bracket: there is no %s to ask",
                  rospy.resolve_name(CAMERA))
    _wait(bracket.done.is_set, end, "no whole bracket came on rgb/image and rgb/focus")
    if bracket.problem:
        raise ValueError(bracket.problem)
    if bracket.depth.shape[1::-1] != bracket.sharpness.size:
        raise ValueError("depth_registered/image_raw and rgb/image have different sizes: does the rig belong to "
                         "these pictures?")
    home = rospy.get_param(f"{CAMERA}/home", "current") if asked else ""
    if home == "current":
        rospy.logwarn("the lens counts its steps from where it stood at the start: start robot.launch with home:=near, so "
                      "that the table holds the next time, too")
    return (bracket.sharpness, dioptres_of_registered(bracket.depth, bracket.sharpness.grid()), home,
            int(rospy.get_param(f"{CAMERA}/first", 0)) if asked else 0,
            int(rospy.get_param(f"{CAMERA}/step", 1)) if asked else 1)


def _wait(condition, end, problem):
    while not condition():
        if time.monotonic() > end or rospy.is_shutdown():
            raise ValueError(problem)
        time.sleep(0.05)


def _ask_for_bracket(bracket):
    """Asks the camera for a bracket; whether there is a camera that can be asked."""
    try:
        rospy.wait_for_service(f"{CAMERA}/bracket", NO_CAMERA)
    except rospy.ROSException:
        return False

    def ask():
        try:
            answer = rospy.ServiceProxy(f"{CAMERA}/bracket", Trigger)()
            problem = "" if answer.success else answer.message
        except rospy.ServiceException as error:
            problem = str(error)
        if problem:
            bracket.problem = problem
            bracket.done.set()
    threading.Thread(target=ask, daemon=True).start()
    return True
