// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <functional>

#include "node_status.hpp"
#include "open_bracket.hpp"

namespace all_in_focus {

/// The topics that the fusion publishes. All messages of one result are latched and have the same header.
class FusionOutputs {
 public:
  /// connect: called whenever a subscriber comes or goes.
  void advertise(ros::NodeHandle& nh, NodeStatus& status, const std::function<void()>& connect);
  /// Whether anybody subscribes.
  bool wanted() const;
  void publish(const FusedBracket& bracket);

 private:
  void publishDepth(const std_msgs::Header& header, const sensor_msgs::ImageConstPtr& depth,
                    const cv::Size& size);

  NodeStatus* status_ = nullptr;
  ros::Publisher image_, weights_, depth_, depth_restored_, source_index_, confidence_, info_, report_;
};

}  // namespace all_in_focus
