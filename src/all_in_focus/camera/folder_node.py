# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Node image_folder_camera: pictures of a folder or a video as if a camera had just taken them."""
import math
import threading
import time

import rospy
from std_msgs.msg import Header

from all_in_focus.camera import parameters
from all_in_focus.camera.file_node import run_node
from all_in_focus.camera.folder_watch import BracketGrouper, FolderWatch
from all_in_focus.camera.frame_publisher import FramePublisher
from all_in_focus.files.stack import Stack, StackError, focus_entries

POLL_PERIOD = 0.1  # s
MOST_UNDER_WAY = 8  # frames that the fusion has not dealt with
ANSWER_TIMEOUT = 5.0  # s


def _poll_until(condition, end=math.inf):
    """Until it holds, it is `end` (monotonic, s), or the node is to end."""
    while not condition() and time.monotonic() < end and not rospy.is_shutdown():
        time.sleep(POLL_PERIOD)


class Pace:
    """Holds frames back while the fusion is behind: it drops what waits too long, and large pictures fill memory."""

    def __init__(self):
        self._under_way = []  # stamps, oldest first
        self._answered = 0.0
        self._subscriber = rospy.Subscriber("all_in_focus/processed", Header, self._on_processed)

    def _on_processed(self, header):
        self._answered = time.monotonic()
        self._under_way = [stamp for stamp in self._under_way if stamp > header.stamp]

    def wait(self, fusion_listens):
        """Before the next frame; not for a fusion that does not answer."""
        if not fusion_listens:
            self._under_way = []
        self._answered = time.monotonic()
        while len(self._under_way) >= MOST_UNDER_WAY and self._subscriber.get_num_connections() \
                and not rospy.is_shutdown():
            if time.monotonic() - self._answered > ANSWER_TIMEOUT:
                self._under_way = []
            time.sleep(0.01)

    def went(self, stamp):
        self._under_way.append(stamp)


class Player:
    """Plays a stack, once or for ever, at a rate."""

    def __init__(self, path, focus):
        self._stack = Stack(path, focus or None)
        for warning in self._stack.warnings:
            rospy.logwarn("%s", warning)
        self._period = 1 / parameters.number("rate", 2.0, 0.001)
        self._loop = parameters.flag("loop", False)
        self._wait_for = parameters.text("wait_for")
        self._wait_timeout = parameters.number("wait_timeout", 10.0, 0)

    def run(self, frames):
        count, bracket_id, pace = len(self._stack), 0, Pace()
        frames.announce(next(iter(self._stack)).shape[1::-1])
        _poll_until(frames.listened)
        if self._wait_for:
            self._wait(frames)
        due = time.monotonic()
        while not rospy.is_shutdown():
            for index, image in enumerate(self._stack):
                time.sleep(max(0, due - time.monotonic()))
                pace.wait(frames.listened_to_all())
                if rospy.is_shutdown():
                    return
                stamp = rospy.Time.now()
                pace.went(stamp)
                frames.publish(image, stamp, bracket_id, index, count, index + 1 == count,
                               self._stack.distances[index])
                due = max(due + self._period, time.monotonic())
            bracket_id += 1
            if not self._loop:
                rospy.loginfo("all %d frames are out", count)
                rospy.spin()  # slow listeners still fetch theirs

    def _wait(self, frames):
        """For a message on ~wait_for that came while the fusion listened: it has seen what this says is there."""
        came = threading.Event()
        end = time.monotonic() + self._wait_timeout if self._wait_timeout else math.inf
        _poll_until(frames.listened_to_all, end)
        subscriber = rospy.Subscriber(self._wait_for, rospy.AnyMsg, lambda _: came.set())
        _poll_until(came.is_set, end)
        subscriber.unregister()
        if not came.is_set() and not rospy.is_shutdown():
            rospy.logwarn("nothing came on %s for %g s: the pictures go out without",
                          rospy.resolve_name(self._wait_for), self._wait_timeout)


class Watcher:
    """Publishes what comes into a folder."""

    def __init__(self, path, focus):
        self._distances = dict(focus_entries(focus)) if focus else {}
        self._watch = FolderWatch(path, rospy.Time.now)
        self._brackets = BracketGrouper(parameters.whole("bracket_size", 0, 0),
                                        parameters.number("bracket_gap", 2.0, 0))
        self._path, self._complaint = path, ""

    def run(self, frames):
        frames.announce()
        rospy.loginfo("watching %s", self._path)
        while not rospy.is_shutdown():
            arrivals = self._poll()
            for arrival in arrivals:
                self._publish(frames, self._brackets.add(arrival))
            if not arrivals:
                self._publish(frames, self._brackets.tick())
            time.sleep(POLL_PERIOD)

    def _poll(self):
        """New pictures; the folder may come and go (a memory card, a network share)."""
        try:
            arrivals, complaint = self._watch.poll(), ""
        except StackError as error:
            arrivals, complaint = [], str(error)
        if complaint and complaint != self._complaint:
            rospy.logwarn("%s; waiting for it", complaint)
        self._complaint = complaint
        while self._watch.warnings:
            rospy.logwarn("%s", self._watch.warnings.pop(0))
        return arrivals

    def _publish(self, frames, ready):
        for arrival, *place in ready:
            frames.publish(arrival.image, arrival.stamp, *place, self._distances.get(arrival.name, math.nan))


def _publish():
    path = parameters.text("stack")
    if not path:
        raise parameters.ParameterError("~stack is missing: give a folder of images or a video")
    source = (Watcher if parameters.flag("watch", False) else Player)(path, parameters.text("focus"))
    frames = FramePublisher(parameters.text("rig"), parameters.whole("width", 0, 0), parameters.text("frame_id"))
    source.run(frames)


def run():
    """Returns the exit code."""
    return run_node("image_folder_camera", _publish)
