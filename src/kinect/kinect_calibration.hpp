// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <camera_info_manager/camera_info_manager.h>
#include <ros/node_handle.h>
#include <sensor_msgs/CameraInfo.h>

#include <string>

#include "kinect_frame.hpp"
#include "kinect_parameters.hpp"

namespace all_in_focus {

/// Pinhole camera with square pixels and without distortion, centred on the image. Its focal length follows
/// from mode.horizontal_fov, or from the Kinect's where the camera does not report one (0).
sensor_msgs::CameraInfo cameraInfoOf(KinectStream stream, const KinectMode& mode);

/// The camera_info of one stream: the calibration, or an estimate from the field of view with one warning.
class KinectCalibration {
 public:
  /// nh: namespace of the images and of the service set_camera_info.
  KinectCalibration(KinectStream stream, const ros::NodeHandle& nh, const KinectStreamParameters& parameters,
                    NodeStatus& status);

  /// The camera_info, without its header.
  sensor_msgs::CameraInfoPtr cameraInfo(const KinectMode& mode);

 private:
  const KinectStream stream_;
  const KinectStreamParameters parameters_;
  NodeStatus& status_;
  camera_info_manager::CameraInfoManager manager_;
  std::string warned_;
};

}  // namespace all_in_focus
