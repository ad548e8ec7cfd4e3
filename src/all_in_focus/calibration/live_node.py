# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_rig --live: takes pairs of pictures from two topics until there are enough, calibrates and ends."""
import contextlib
import threading
import time
from collections import deque

import cv_bridge
import message_filters
import rospy
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger, TriggerResponse

from all_in_focus.calibration.live_view import LiveView
from all_in_focus.files.errors import one_line
from all_in_focus.image_messages import BRIDGE, ImageError, bgr

TOPICS = ("ir/image", "rgb/image")
SIXTEEN_BIT = ("mono16", "16UC1")
SLOP = 0.2  # s between the two pictures; the board is held still
SILENCE = 5.0  # s
POLL = 0.05  # s
MORE = 5  # pairs to wait before a calibration that failed is tried again
GRACE = 1.0  # s for the answer of ~finish to be sent


class LiveNode:
    """calibrate: function of pairs and sizes that returns lines, or raises ValueError."""

    def __init__(self, view, calibrate):
        self._view, self._calibrate = view, calibrate
        self._lock = threading.Lock()  # of the view, and of the end
        self._newest = deque(maxlen=1)  # pairs that come during a search are skipped
        self._last_heard, self._last_pair = [time.monotonic()] * 2, time.monotonic()
        self._done, self._next_try = False, 0
        self._picture = rospy.Publisher("~coverage", Image, queue_size=1, latch=True)
        rospy.Service("~finish", Trigger, self._finish)
        subscribers = [message_filters.Subscriber(topic, Image, queue_size=5, buff_size=2 ** 26) for topic in TOPICS]
        for index, subscriber in enumerate(subscribers):
            subscriber.registerCallback(self._heard, index)
        self._synchronizer = message_filters.ApproximateTimeSynchronizer(subscribers, 30, SLOP)
        self._synchronizer.registerCallback(self._pair)

    def _heard(self, _, index):
        self._last_heard[index] = time.monotonic()

    def _pair(self, *messages):
        self._newest.append(messages)
        self._last_pair = time.monotonic()

    def run(self):
        """Runs until the rig is written or the node is shut down."""
        while not rospy.is_shutdown() and not self._done:
            if not self._newest:
                self._name_the_silent()
                time.sleep(POLL)
                continue
            images = self._images(self._newest.pop())
            with self._lock:
                if images and not self._done:
                    self._look(images)
        if self._done:
            time.sleep(GRACE)

    def _images(self, messages):
        try:
            return [BRIDGE.imgmsg_to_cv2(message) if message.encoding in SIXTEEN_BIT else bgr(message) for message in messages]
        except (cv_bridge.CvBridgeError, ImageError) as error:
            rospy.logwarn_throttle(10, f"a picture cannot be used: {error}")
            return None

    def _look(self, images):
        try:
            if self._view.add(images):
                rospy.loginfo("%s", "; ".join(self._view.status()))
        except OSError as error:  # the pair counts all the same
            rospy.logwarn("%s", error)
        if self._view.enough and len(self._view.pairs) >= self._next_try:
            try:
                self._end()
            except (ValueError, OSError) as error:
                self._next_try = len(self._view.pairs) + MORE
                rospy.logwarn("%s; taking more pairs", one_line(error))
        if self._picture.get_num_connections() or self._done:
            self._picture.publish(BRIDGE.cv2_to_imgmsg(self._view.picture()[..., ::-1].copy(), "rgb8"))

    def _end(self):
        if not self._view.pairs:
            raise ValueError("no pair is taken yet: show the board to both cameras and hold it still")
        lines = self._calibrate(self._view.pairs, self._view.sizes)
        for line in lines:
            rospy.loginfo("%s", line)
        self._done = True
        return lines

    def _finish(self, _):
        with self._lock:
            if self._done:
                return TriggerResponse(True, "finished already")
            try:
                return TriggerResponse(True, "; ".join(self._end()[-4:]))
            except (ValueError, OSError) as error:
                return TriggerResponse(False, one_line(error))

    def end(self):
        """Whether the rig is written, if only by ~finish at the last moment. Nothing writes it from now on: the folder that it is
        written in is about to be removed."""
        self._lock.acquire()
        return self._done

    def _name_the_silent(self):
        now = time.monotonic()
        for index, topic in enumerate(TOPICS):
            if now - self._last_heard[index] > SILENCE:
                rospy.logwarn_throttle(30, f"nothing comes on {rospy.resolve_name(topic)}: is its camera on, is the "
                                           "topic remapped?")
                return
        if now - self._last_pair > SILENCE:
            rospy.logwarn_throttle(30, f"both cameras' pictures come, but their stamps are more than {SLOP:g} s apart")


def run(arguments, calibrate):
    """Returns the exit code."""
    rospy.init_node("calibrate_rig", disable_signals=True)
    view = LiveView(arguments.board, arguments.views, arguments.save_pictures)
    node = LiveNode(view, calibrate)
    rospy.loginfo("pictures from %s and %s, coverage on %s; ends with %d pairs that cover enough, or by %s",
                  *map(rospy.resolve_name, TOPICS + ("~coverage",)), arguments.views, rospy.resolve_name("~finish"))
    with contextlib.suppress(KeyboardInterrupt):
        node.run()
    if node.end():
        return 0
    rospy.logerr("ended before there were enough pairs: no rig was written")
    return 2
