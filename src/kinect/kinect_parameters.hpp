// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/node_handle.h>

#include <array>
#include <string>
#include <vector>

#include "kinect_device.hpp"
#include "node_status.hpp"

namespace all_in_focus {

/// Parameters of one stream.
struct KinectStreamParameters {
  std::string name;      ///< camera name in the calibration file
  std::string frame_id;  ///< optical frame
  std::string info_url;  ///< URL of the calibration; empty: ~/.ros/camera_info/NAME.yaml
};

struct KinectParameters {
  std::string device;  ///< see KinectDevice
  KinectPlayback playback;
  std::vector<int> invalid_values{0, 2047, 65535};  ///< depths in mm that mean "unknown"
  double time_offset = 0.0;       ///< s, added to the stamps; minus the delay from exposure to arrival
  double reconnect_period = 1.0;  ///< s between attempts to open the camera
  double silence_timeout = 5.0;   ///< s without an image after which the camera is reopened; 0: never
  int queue_size = 5;             ///< images that wait for a slow subscriber
  std::array<KinectStreamParameters, 3> streams;  ///< indexed by KinectStream
};

/// Reads the private parameters. An impossible value is reported to the status, and replaced by the default.
KinectParameters readKinectParameters(const ros::NodeHandle& private_nh, NodeStatus& status);

}  // namespace all_in_focus
