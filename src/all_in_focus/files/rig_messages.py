# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The files of a rig folder as ROS messages."""
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header


def camera_info(camera, header):
    return CameraInfo(header=header, width=camera.width, height=camera.height, distortion_model=camera.distortion_model,
                      D=camera.D.ravel().tolist(), K=camera.K.ravel().tolist(), R=camera.R.ravel().tolist(),
                      P=camera.P.ravel().tolist())


def static_transform(rig, stamp):
    """Pose of the depth camera in the colour camera's frame (m), with the numbers as they stand in extrinsics.yaml."""
    transform = TransformStamped(header=Header(stamp=stamp, frame_id=rig.parent_frame), child_frame_id=rig.child_frame)
    transform.transform.translation = Vector3(*rig.t.tolist())
    transform.transform.rotation = Quaternion(*rig.quaternion.tolist())
    return transform
