# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Publishes the frames of a focus bracket: image, camera_info and focus, all with the same stamp."""
import math
import time
from dataclasses import dataclass

import cv2
import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from all_in_focus.files.rig import Camera, load_rig, same_shape
from all_in_focus.files.rig_messages import camera_info
from all_in_focus.image_messages import color_message
from all_in_focus.msg import FocusFrame
from all_in_focus.parameters import Parameter

PARAMETERS = {
    "rig": Parameter("", "folder with the calibration"),
    "width": Parameter(0, "pixels; pictures are shrunk to this width; 0: as they come", 0),
    "frame_id": Parameter("", "empty: the rig's colour frame, else rgb_optical_frame"),
}
QUEUE = 30  # frames that may wait for a slow subscriber
CORRECTION = 0.1  # s by which a corrected FocusFrame precedes its image: topics do not keep their order
GRACE = 1.0  # s for a subscriber of the images to connect to the other topics, too


@dataclass
class Frame:
    """One of a focus bracket: see FocusFrame.msg. stamp: of the release; distance: m, NaN = unknown; image: BGR, 8 or
    16 bit, None until it is there."""
    index: int
    count: int
    last: bool
    distance: float
    bracket_id: int = 0
    stamp: rospy.Time = None
    image: np.ndarray = None


class FramePublisher(rospy.SubscribeListener):
    """settings: values of PARAMETERS. on_subscriber: called whenever somebody begins to listen to the images."""

    def __init__(self, settings):
        rig = load_rig(settings.rig) if settings.rig else None
        self._calibration = rig.color if rig else None
        self._frame_id = settings.frame_id or (rig.parent_frame if rig else "rgb_optical_frame")
        self._width = settings.width
        self._info = None  # rig.Camera for the size of the last picture
        self._sent = None  # stamp, and (bracket_id, index, count, last), of the FocusFrame that was published last
        self._listened_since = math.inf
        self.on_subscriber = lambda: None
        self._image_publisher = rospy.Publisher("rgb/image", Image, subscriber_listener=self, queue_size=QUEUE)
        self._info_publisher = rospy.Publisher("rgb/camera_info", CameraInfo, queue_size=QUEUE, latch=True)
        self._focus_publisher = rospy.Publisher("rgb/focus", FocusFrame, queue_size=QUEUE)

    def peer_subscribe(self, *_):
        self._listened_since = time.monotonic()
        self.on_subscriber()

    def announce(self, size=None):
        """Publish the calibration before the first frame: registering depth and planning the focus need it.

        size: (width, height) of the pictures to come; None: take that of the last picture, at first that of the calibration.
        """
        if self._calibration is None:
            return
        like = self._info or self._calibration
        camera = self._camera_of(*self._published(size or (like.width, like.height)))
        if camera.K[0, 0]:
            self._info_publisher.publish(camera_info(camera, self._header(rospy.Time.now())))

    def has_all_listeners(self):
        """Whether image, camera_info and focus all have a subscriber, as they have when the fusion runs."""
        publishers = (self._image_publisher, self._info_publisher, self._focus_publisher)
        return all(publisher.get_num_connections() for publisher in publishers)

    def has_listeners(self):
        """Whether somebody subscribes to the images, and has had time to connect to the other topics, too. That they have a
        subscriber says nothing: it may be another one."""
        rospy.topics.get_topic_manager().check_all()  # else rospy takes who has left for present for another half second
        return self._image_publisher.get_num_connections() > 0 and time.monotonic() > self._listened_since + GRACE

    def publish_focus(self, frame):
        """Publish the FocusFrame at the release: the fusion keeps the regions and the depth of this moment until the
        image follows. A second one with the same stamp, before the image, replaces the first."""
        focus = (frame.bracket_id, frame.index, frame.count, frame.last)
        if self._sent != (frame.stamp, focus):
            self._focus_publisher.publish(FocusFrame(self._header(frame.stamp), *focus, frame.distance))
            self._sent = (frame.stamp, focus)

    def publish(self, frame):
        """The FocusFrame goes first, unless it is out already."""
        before = self._sent
        self.publish_focus(frame)
        if before and before[0] == frame.stamp and before != self._sent:
            time.sleep(CORRECTION)
        image, size = frame.image, self._published(frame.image.shape[1::-1])
        if size != image.shape[1::-1]:
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        header = self._header(frame.stamp)
        self._info_publisher.publish(camera_info(self._camera_of(*size), header))
        self._image_publisher.publish(color_message(np.ascontiguousarray(image), header))

    def _header(self, stamp):
        return Header(stamp=stamp, frame_id=self._frame_id)

    def _published(self, size):
        """(width, height) with which pictures of this size are published."""
        width, height = size
        return (self._width, max(1, round(height * self._width / width))) if self._width else size

    def _camera_of(self, width, height):
        if self._info is None or (self._info.width, self._info.height) != (width, height):
            self._info = self._fitted(width, height)
        return self._info

    def _fitted(self, width, height):
        """The calibration for pictures of this size; K is all zeros, as REP 104 asks, where there is none."""
        camera = self._calibration
        if camera and (camera.width, camera.height) == (width, height):
            return camera
        uncalibrated = Camera("uncalibrated", width, height, np.zeros((3, 3)))
        if camera is None:
            rospy.logwarn("no calibration (parameter ~rig): rgb/camera_info is empty")
            return uncalibrated
        sizes = f"pictures have {width}x{height} pixels, the calibration has {camera.width}x{camera.height}"
        if not same_shape((camera.width, camera.height), (width, height)):
            rospy.logwarn("%s: another shape, rgb/camera_info is empty", sizes)
            return uncalibrated
        rospy.loginfo("%s: scaled", sizes)
        return camera.scaled(width, height)
