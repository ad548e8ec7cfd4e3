# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Node depth_file_camera: publishes one depth image on depth/image_raw and depth/camera_info, again and again."""
from pathlib import Path

import cv_bridge
import rospy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from all_in_focus.camera import parameters
from all_in_focus.files.rig import load_camera
from all_in_focus.files.rig_messages import camera_info
from all_in_focus.files.stack import StackError, read_depth


class DepthFileCamera:
    """path: 16-bit image, mm; rig: folder with its depth.yaml."""

    def __init__(self, path, rig, frame_id):
        depth, self._camera = read_depth(path), load_camera(str(Path(rig) / "depth.yaml"))
        height, width = depth.shape
        if (self._camera.width, self._camera.height) != (width, height):
            raise StackError(f"{path}: {width}x{height} pixels, but depth.yaml says "
                             f"{self._camera.width}x{self._camera.height}")
        self._message = cv_bridge.CvBridge().cv2_to_imgmsg(depth, "16UC1")
        self._frame_id = frame_id
        self._image_publisher = rospy.Publisher("depth/image_raw", Image, queue_size=1)
        self._info_publisher = rospy.Publisher("depth/camera_info", CameraInfo, queue_size=1)

    def publish(self, stamp):
        """Publish the image and its camera_info, if somebody subscribes to either."""
        if not (self._image_publisher.get_num_connections() or self._info_publisher.get_num_connections()):
            return
        self._message.header = Header(stamp=stamp, frame_id=self._frame_id)
        self._info_publisher.publish(camera_info(self._camera, self._message.header))
        self._image_publisher.publish(self._message)


def publish():
    """Until shutdown; ValueError for wrong parameters and files."""
    paths = {name: parameters.text(name) for name in ("depth", "rig")}
    for name, path in paths.items():
        if not path:
            raise parameters.ParameterError(f"~{name} is missing")
    rate = rospy.Rate(parameters.number("rate", 5.0, 0.1))
    camera = DepthFileCamera(paths["depth"], paths["rig"], parameters.text("frame_id", "depth_optical_frame"))
    while not rospy.is_shutdown():
        camera.publish(rospy.Time.now())
        rate.sleep()
