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
from all_in_focus.files.stack import read_depth


def publish():
    """Until shutdown; ValueError for wrong parameters and files."""
    paths = {name: parameters.text(name) for name in ("depth", "rig")}
    for name, path in paths.items():
        if not path:
            raise parameters.ParameterError(f"~{name} is missing")
    rate = rospy.Rate(parameters.number("rate", 5.0, 0.1))
    camera = load_camera(str(Path(paths["rig"], "depth.yaml")))
    message = cv_bridge.CvBridge().cv2_to_imgmsg(read_depth(paths["depth"], camera), "16UC1")
    frame_id = parameters.text("frame_id", "depth_optical_frame")
    images = rospy.Publisher("depth/image_raw", Image, queue_size=1)
    infos = rospy.Publisher("depth/camera_info", CameraInfo, queue_size=1)
    while not rospy.is_shutdown():
        if images.get_num_connections() or infos.get_num_connections():
            message.header = Header(stamp=rospy.Time.now(), frame_id=frame_id)
            infos.publish(camera_info(camera, message.header))
            images.publish(message)
        rate.sleep()
