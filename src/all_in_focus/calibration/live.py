# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""calibrate_rig --live: takes pairs of pictures from two topics until there are enough, and shows what is still missing.

A view is worth taking when it differs from those taken before, as ROS's camera_calibration judges it, in either camera.
"""
import queue
import time
from collections import deque
from pathlib import Path

import cv2
import message_filters
import numpy as np
import rospy
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger, TriggerResponse

from all_in_focus.calibration.board import CAMERAS, Pair, find_corners, gray
from all_in_focus.files.errors import one_line
from all_in_focus.files.output_file import write_picture
from all_in_focus.image_messages import BRIDGE, MILLIMETRES, ImageError, bgr, check_depth, depth_as_sent
from all_in_focus.imaging import contact_sheet, shrunk, with_lines

TOPICS = ("ir/image", "rgb/image")
SLOP = 0.2  # s between the two pictures; the board is held still
SILENCE = 5.0  # s
POLL = 0.05  # s
MORE = 5  # pairs to wait before a calibration that failed is tried again
GRACE = 1.0  # s for the answer of ~finish to be sent

WIDTH = 480  # pixels, of both pictures
TAKEN, SEEN = (60, 200, 60), (60, 180, 255)  # BGR
NEW = 0.2  # a new view differs by so much, summed over what measure() returns
RANGES = np.array([0.7, 0.7, 0.4, 0.5])  # of what measure() returns, that the views must span; size and tilt from 0 on
ADVICE = ("to the left and right border", "to the upper and lower border", "nearer", "tilted more")
STILL = 0.003  # of the picture's width: a board that is held still moves less from picture to picture


def measure(outline, size):
    """Place across and down (0..1), size (share of the picture's side), tilt (0..1) of a board; outline: 4 x 2, pixels.

    size: (width, height) of the picture.
    """
    area = cv2.contourArea(outline.astype(np.float32))
    side = np.sqrt(area)
    middle = outline.mean(axis=0)
    place = np.clip((middle - side / 2) / np.maximum(np.array(size) - side, 1), 0, 1)
    edges = outline[[0, 2]] - outline[1]
    cosine = edges[0] @ edges[1] / np.prod(np.linalg.norm(edges, axis=1))
    tilt = min(1, 2 * abs(np.pi / 2 - np.arccos(np.clip(cosine, -1, 1))))
    return np.array([*place, np.sqrt(area / np.prod(size)), tilt])


def spanned(views):
    """Share of each of RANGES, in the camera that has seen more of it: the other camera may have a field of view so wide that
    the board cannot reach its borders in both. views: N x 2 x 4, measure() of both."""
    views = np.reshape(views, (-1, 2, 4))
    if not len(views):
        return np.zeros(4)
    low = views.min(axis=0) * [1, 1, 0, 0]
    return np.minimum(1, (views.max(axis=0) - low).max(axis=0) / RANGES)


def moved(board, corners, before):
    """Mean distance in pixels that the board has moved; the order of the corners may have changed."""
    return min(float(np.linalg.norm(order - before, axis=1).mean()) for order in board.orders(corners))


class LiveView:
    """The pairs of a live calibration. wanted: least number of pairs; pictures: folder that keeps them, or None."""

    def __init__(self, board, wanted, pictures=None):
        self._board, self._wanted, self._folder = board, wanted, Path(pictures) if pictures else None
        self._before = (None, None)  # corners in the last two pictures
        self._now = None  # (images, outlines, what was said) of the last two
        self._taken = []  # outlines of the board in both cameras, by pair
        self._views = []  # measure() of both cameras, by pair
        self.pairs, self.sizes = [], None
        for camera in CAMERAS if pictures else ():
            folder = self._folder / camera
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise ValueError(f"{folder}: holds pictures already: name another folder")

    @property
    def enough(self):
        return len(self.pairs) >= self._wanted and (spanned(self._views) == 1).all()

    def add(self, images):
        """Looks at the two pictures of one moment; returns whether the pair is taken. OSError where it is taken, but
        its pictures cannot be saved."""
        sizes = tuple(image.shape[1::-1] for image in images)
        self.sizes = self.sizes or sizes
        pair = Pair(f"{len(self.pairs):03}", *(find_corners(image, self._board, thorough=False) for image in images))
        corners = (pair.depth, pair.color)
        outlines = [None if found is None else self._board.outline(found) for found in corners]
        said, view = pair.problem, None
        if sizes != self.sizes:
            said = "left out: the size of the pictures has changed"
        elif not said:
            view = [measure(*camera) for camera in zip(outlines, sizes)]
            if any(before is None or moved(self._board, found, before) > STILL * size[0]
                   for found, before, size in zip(corners, self._before, sizes)):
                said = "hold it still"
            elif any(np.abs(np.subtract(view, other)).sum(axis=1).max() <= NEW for other in self._views):
                said = "like one that is taken: move or tilt it"
        self._before, self._now = corners, (images, outlines, said or "taken")
        if said:
            return False
        self.pairs.append(pair)
        self._views.append(view)
        self._taken.append(outlines)
        for camera, image in zip(CAMERAS, images) if self._folder else ():
            write_picture(self._folder / camera / f"{pair.name}.png", image)
        return True

    def status(self):
        """Two lines: the progress, and what to do next."""
        shares = spanned(self._views)
        across, down, size, tilt = (f"{100 * share:.0f} %" for share in shares)
        lacking = [advice for advice, share in zip(ADVICE, shares) if share < 1]
        todo = f"show it {', '.join(lacking)}" if lacking else "any new view"
        return [f"{len(self.pairs)} of {self._wanted} pairs; across {across}, down {down}, size {size}, tilt {tilt}",
                f"{self._now[2]}; then: {todo}"]

    def picture(self):
        """BGR: both cameras' images side by side, boards of the views taken in green, the board seen now in orange; call
        after add()."""
        panes, (images, outlines, _) = [], self._now
        for camera, (image, seen) in enumerate(zip(images, outlines)):
            pane = cv2.cvtColor(np.rint(gray(shrunk(image, WIDTH))).astype(np.uint8), cv2.COLOR_GRAY2BGR)
            scale = pane.shape[1] / image.shape[1]
            covered = pane.copy()
            for taken in self._taken:
                cv2.fillConvexPoly(covered, np.rint(taken[camera] * scale).astype(np.int32), TAKEN)
            pane = cv2.addWeighted(covered, 0.3, pane, 0.7, 0)
            if seen is not None:
                cv2.polylines(pane, [np.rint(seen * scale).astype(np.int32)], True, SEEN, 3, cv2.LINE_AA)
            panes.append(pane)
        return with_lines(contact_sheet(panes, CAMERAS, 2, WIDTH), self.status())


def run(view, calibrate):
    """Takes pairs until there are enough, or ~finish is called, and calibrate() succeeds with them. calibrate: function of
    pairs and sizes that returns lines, or raises ValueError or OSError."""
    rospy.init_node("calibrate_rig", disable_signals=True)
    newest = deque(maxlen=1)  # pairs that come during a search are skipped
    requests = []  # a queue for the answer to each call of ~finish

    def finish(_):
        answer = queue.Queue()
        requests.append(answer)
        return TriggerResponse(*answer.get())
    pictures = rospy.Publisher("~coverage", Image, queue_size=1, latch=True)
    rospy.Service("~finish", Trigger, finish)
    synchronizer = message_filters.ApproximateTimeSynchronizer(
        [message_filters.Subscriber(topic, Image, queue_size=5, buff_size=2 ** 26) for topic in TOPICS], 30, SLOP)
    synchronizer.registerCallback(lambda *pair: newest.append(pair))
    topics = " and ".join(map(rospy.resolve_name, TOPICS))
    rospy.loginfo("pictures from %s, coverage on %s; ends when the pairs cover enough, or by %s", topics,
                  *map(rospy.resolve_name, ("~coverage", "~finish")))
    next_try, last = 0, time.monotonic()
    while not rospy.is_shutdown():
        if newest:
            last = time.monotonic()
            _look(view, newest.pop(), pictures)
        elif time.monotonic() > last + SILENCE:
            rospy.logwarn_throttle(30, f"no pair of pictures for {SILENCE:g} s: do {topics} both come, with stamps less "
                                       f"than {SLOP:g} s apart?")
        if requests or view.enough and len(view.pairs) >= next_try:
            try:
                if not view.pairs:
                    raise ValueError("no pair is taken yet: show the board to both cameras and hold it still")
                lines, done = calibrate(view.pairs, view.sizes), True
                rospy.loginfo("%s", "\n".join(lines))
            except (ValueError, OSError) as error:
                lines, done, next_try = [one_line(error)], False, len(view.pairs) + MORE
                rospy.logwarn("%s; taking more pairs", *lines)
            while requests:
                requests.pop().put((done, lines[-1]))
            if done:
                time.sleep(GRACE)
                return
        time.sleep(POLL)
    raise ValueError("ended before there were enough pairs: no rig was written")


def _picture(message):
    """8 bit, BGR, or 16 bit, as infrared cameras send it. ImageError."""
    if message.encoding not in MILLIMETRES:
        return bgr(message)
    check_depth(message)
    return depth_as_sent(message)


def _look(view, messages, pictures):
    images = []
    try:
        for message in messages:
            images.append(_picture(message))
        if view.add(images):
            rospy.loginfo("%s", "; ".join(view.status()))
    except ImageError as error:
        rospy.logwarn_throttle(10, f"{rospy.resolve_name(TOPICS[len(images)])}: a picture cannot be used: {error}")
        return
    except OSError as error:  # the pair counts all the same
        rospy.logwarn("%s", error)
    if pictures.get_num_connections():
        pictures.publish(BRIDGE.cv2_to_imgmsg(view.picture()[..., ::-1].copy(), "rgb8"))
