# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_focus --live: one bracket of the running cameras, and the registered depth of its beginning."""
import queue
import threading
import time

import message_filters
import rospy
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from all_in_focus.calibration.focus_curve import Sharpness, dioptres_of_registered
from all_in_focus.image_messages import bgr, depth_mm
from all_in_focus.msg import FocusFrame

CAMERA, DEPTH = "focus_bracket_camera", "depth_registered/image_raw"
QUEUE = 100  # frames
NO_CAMERA = 2.0  # s without the camera's service: the next bracket of whatever camera is taken


def shoot(timeout):
    """(Sharpness, dioptres of its tiles, home, first, step); the last three as focus_bracket_camera has them."""
    rospy.init_node("calibrate_focus", anonymous=True, disable_signals=True)
    came = queue.Queue()  # depth images, pairs of image and FocusFrame, or why no bracket will come
    end = time.monotonic() + timeout
    rospy.on_shutdown(lambda: came.put("stopped from outside"))

    def following(problem):
        try:
            what = came.get(timeout=max(0, end - time.monotonic()))
        except queue.Empty:
            what = problem
        if isinstance(what, str):
            raise ValueError(what)
        return what

    rospy.loginfo("waiting for depth on %s", rospy.resolve_name(DEPTH))
    rospy.Subscriber(DEPTH, Image, came.put, queue_size=1, buff_size=2 ** 26)
    depth = following(f"no depth came on {DEPTH}: is robot.launch running, with a rig?")
    frames = message_filters.TimeSynchronizer(
        [message_filters.Subscriber("rgb/image", Image, queue_size=QUEUE, buff_size=2 ** 26),
         message_filters.Subscriber("rgb/focus", FocusFrame, queue_size=QUEUE)], QUEUE)
    frames.registerCallback(lambda *frame: came.put(frame))
    asked = _ask_for_bracket(came.put)
    rospy.loginfo("asked %s for a bracket" if asked else "waiting for the next bracket: there is no %s to ask",
                  rospy.resolve_name(CAMERA))

    sharpness, bracket_id, is_whole = None, None, False
    while not is_whole:
        what = following("no whole bracket came on rgb/image and rgb/focus")
        if isinstance(what, Image):
            depth = depth if sharpness else what  # that of the beginning
            continue
        image, focus = what
        if focus.index == 0:
            sharpness, bracket_id = Sharpness(), focus.bracket_id
        if focus.bracket_id != bracket_id:
            continue
        if focus.index != len(sharpness.frames):
            raise ValueError(f"frame {len(sharpness.frames)} of the bracket never came")
        sharpness.add(bgr(image))
        is_whole = focus.last
    if (depth.width, depth.height) != sharpness.size:
        raise ValueError(f"{DEPTH} and rgb/image have different sizes: does the rig belong to these pictures?")
    home = (rospy.get_param(f"{CAMERA}/home", "") or "current") if asked else ""
    if home == "current":
        rospy.logwarn("the lens counts its steps from where it stood at the start: start robot.launch with home:=near, so "
                      "that the table holds the next time, too")
    return (sharpness, dioptres_of_registered(depth_mm(depth), sharpness.grid()), home,
            int(rospy.get_param(f"{CAMERA}/first", 0)) if asked else 0, int(rospy.get_param(f"{CAMERA}/step", 1)) if asked else 1)


def _ask_for_bracket(tell):
    """Asks the camera for a bracket; whether there is a camera that can be asked. tell: of the reason why there is none."""
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
            tell(problem)
    threading.Thread(target=ask, daemon=True).start()
    return True
