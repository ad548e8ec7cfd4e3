// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/node_handle.h>

#include <string>
#include <vector>

#include "kinect_device.hpp"
#include "node_monitor.hpp"

namespace all_in_focus {

/// Of one topic.
struct KinectStreamParameters {
  std::string name;      ///< of the camera, as it stands in its calibration file
  std::string frame_id;  ///< optical frame
  std::string info_url;  ///< of its calibration; empty: ~/.ros/camera_info/NAME.yaml
};

struct KinectParameters {
  std::string device;  ///< URI, .oni file, "#n" or "" (the first)
  KinectPlayback playback;
  std::vector<int> invalid_values{0, 2047};  ///< mm that mean unknown
  double time_offset = 0.0;           ///< s, added to the stamps: minus the delay from exposure to arrival
  double reconnect_period = 1.0;      ///< s between attempts
  double silence_timeout = 5.0;       ///< s without an image until a camera is opened again; 0: never
  int queue_size = 5;                 ///< images that wait for a slow subscriber
  KinectStreamParameters streams[3];  ///< by KinectStream
};

/// Reads the private parameters; says through the monitor what is impossible, and takes the default instead.
KinectParameters readKinectParameters(const ros::NodeHandle& private_nh, NodeMonitor& monitor);

}  // namespace all_in_focus
