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

/// Pinhole camera without distortion, of square pixels, its centre in the middle of the image.
/// horizontal_fov: rad; where the camera does not tell it (0), that of a Kinect.
sensor_msgs::CameraInfo cameraInfoOf(KinectStream stream, const KinectMode& mode);

/// The camera_info of one stream: as calibrated, else from the field of view, with one warning.
class KinectCalibration {
 public:
  /// nh: where the service set_camera_info is offered, and the images are published.
  KinectCalibration(KinectStream stream, const ros::NodeHandle& nh, const KinectStreamParameters& parameters,
                    NodeMonitor& monitor);

  /// All but the header.
  sensor_msgs::CameraInfoPtr cameraInfo(const KinectMode& mode);

 private:
  void warnOnce(const std::string& text);

  const KinectStream stream_;
  const KinectStreamParameters parameters_;
  NodeMonitor& monitor_;
  camera_info_manager::CameraInfoManager manager_;
  std::string warned_;
};

}  // namespace all_in_focus
