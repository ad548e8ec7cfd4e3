# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Node image_folder_camera: publishes the pictures of a folder or a video as if a camera had just taken them."""
import math
import time

import rospy
from std_msgs.msg import Header

from all_in_focus.acknowledgements import Acknowledgements
from all_in_focus.camera import frame_publisher
from all_in_focus.camera.folder_watch import BracketGrouper, FolderWatch
from all_in_focus.camera.frame_publisher import Frame, FramePublisher
from all_in_focus.files.stack import Stack, StackError, focus_of_arrivals
from all_in_focus.parameters import Parameter

PARAMETERS = {
    "stack": Parameter("", "folder of images, or a video"),
    "focus": Parameter("", "YAML file: focus distances, or a focus table"),
    **frame_publisher.PARAMETERS,
    "rate": Parameter(2.0, "frames a second", 0.001),
    "loop": Parameter(False, "again and again, each time as a new bracket"),
    "wait_for": Parameter("", "topic on which a message must come before the first frame"),
    "wait_timeout": Parameter(10.0, "s, how long; 0: for ever", 0),
    "watch": Parameter(False, "publish what comes into the folder from now on"),
    "bracket_size": Parameter(0, "watching: frames; 0: a bracket ends with a pause", 0),
    "bracket_gap": Parameter(2.0, "watching: s, the pause that ends a bracket", 0),
}
POLL_PERIOD, FLOW_PERIOD = 0.1, 0.005  # s
MAX_UNPROCESSED = 8  # published frames that the fusion has not acknowledged yet
ACKNOWLEDGE_TIMEOUT = 5.0  # s
RESULT_TIMEOUT = 120.0  # s: the last frame of a bracket is acknowledged when its picture is restored


def _poll_until(condition, end=math.inf):
    """Wait until the condition holds, the monotonic clock shows `end` (s), or the node shuts down."""
    while not condition() and time.monotonic() < end and not rospy.is_shutdown():
        time.sleep(min(POLL_PERIOD, max(0, end - time.monotonic())))


class Player:
    def __init__(self, settings):
        self._stack = Stack(settings.stack, settings.focus or None, deep=True)
        for warning in self._stack.warnings:
            rospy.logwarn("%s", warning)
        self._settings = settings
        self.flow = Acknowledgements()
        self._acknowledgements = rospy.Subscriber("all_in_focus/processed", Header, self.flow.came)

    def run(self, frames):
        count, bracket_id, wait_for = len(self._stack), 0, self._settings.wait_for
        frames.on_subscriber = self.flow.give_up  # maybe the fusion, which stopped for a moment
        frames.announce(next(iter(self._stack)).shape[1::-1])
        rospy.loginfo("%s: %d frames, which wait for a listener on %s%s", self._settings.stack, count,
                      rospy.resolve_name("rgb/image"), f", and for {rospy.resolve_name(wait_for)}" if wait_for else "")
        _poll_until(frames.has_listeners)
        if wait_for:
            self._wait(frames)
        due = time.monotonic()
        while not rospy.is_shutdown():
            for index, image in enumerate(self._stack):
                _poll_until(lambda: False, due)
                self.await_fusion(frames.has_all_listeners, new_bracket=index == 0)
                if rospy.is_shutdown():
                    return
                stamp = rospy.Time.now()
                if frames.has_all_listeners():
                    self.flow.sent(Header(stamp=stamp))
                distance = self._stack.distances[index]
                frames.publish(Frame(index, count, index + 1 == count, distance, bracket_id, stamp, image))
                due = max(due + 1 / self._settings.rate, time.monotonic())
            bracket_id += 1
            if not self._settings.loop:
                rospy.loginfo("all %d frames are published", count)
                rospy.spin()  # stay: slow subscribers are still fetching frames

    def await_fusion(self, fusion_listens, new_bracket):
        """Delays a frame while the fusion is behind: it would drop frames that wait too long, and large ones fill memory. A
        bracket waits for the result of the one before it. Gives up on a fusion that has left, or acknowledges nothing for
        ACKNOWLEDGE_TIMEOUT, RESULT_TIMEOUT before a bracket. fusion_listens: function."""
        most, patience = (1, RESULT_TIMEOUT) if new_bracket else (MAX_UNPROCESSED, ACKNOWLEDGE_TIMEOUT)
        received, since = self.flow.received, time.monotonic()
        while self.flow.under_way() >= most and not rospy.is_shutdown():
            if self.flow.received > received:
                received, since = self.flow.received, time.monotonic()
            elif time.monotonic() > since + patience or not fusion_listens() \
                    or not self._acknowledgements.get_num_connections():
                self.flow.give_up()
            time.sleep(FLOW_PERIOD)

    def _wait(self, frames):
        """Wait until the fusion listens, then for a message on ~wait_for: the fusion has received what it announces."""
        end = time.monotonic() + (self._settings.wait_timeout or math.inf)
        _poll_until(frames.has_all_listeners, end)
        try:
            rospy.wait_for_message(self._settings.wait_for, rospy.AnyMsg, max(POLL_PERIOD, end - time.monotonic()))
        except rospy.ROSInterruptException:
            raise
        except rospy.ROSException:
            rospy.logwarn("nothing came on %s for %g s: the pictures are published without waiting longer",
                          rospy.resolve_name(self._settings.wait_for), self._settings.wait_timeout)


def watch(settings, frames):
    """The folder may disappear and come back (a memory card, a network share)."""
    distance = [focus_of_arrivals(settings.focus)] if settings.focus else []
    brackets = BracketGrouper(settings.bracket_size, settings.bracket_gap, *distance)
    folder = FolderWatch(settings.stack, rospy.Time.now)
    frames.announce()
    rospy.loginfo("watching %s", settings.stack)
    last_error = ""
    while not rospy.is_shutdown():
        try:
            arrivals, error = folder.poll(), ""
        except StackError as failure:
            arrivals, error = [], str(failure)
        if error and error != last_error:
            rospy.logwarn("%s; waiting for it", error)
        last_error = error
        while folder.warnings:
            rospy.logwarn("%s", folder.warnings.pop(0))
        for frame in map(brackets.after, arrivals or [None]):
            if frame:
                frames.publish(frame)
        time.sleep(POLL_PERIOD)


def publish(settings):
    """Until shutdown; ValueError for wrong parameters and files."""
    if not settings.stack:
        raise ValueError("~stack is missing: give a folder of images or a video")
    if settings.watch:
        watch(settings, FramePublisher(settings))
    else:
        Player(settings).run(FramePublisher(settings))
