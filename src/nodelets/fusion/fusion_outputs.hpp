// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FocusFrame.h>
#include <all_in_focus/FusionReport.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>

#include <functional>
#include <mutex>

#include "all_in_focus/bracket.hpp"
#include "bracket_scene.hpp"
#include "node_status.hpp"

namespace all_in_focus {

/// The topics that the fusion publishes. All messages of one result have the same header. They are latched;
/// the cloud, which is large, is made when somebody listens to it.
class FusionOutputs {
 public:
  /// connect: called by nh's callbacks whenever a subscriber comes or goes.
  FusionOutputs(ros::NodeHandle& nh, NodeStatus& status, const std::function<void()>& connect);
  /// Whether anybody subscribes.
  bool wanted() const;
  /// Which frame of which bracket has come.
  void tell(const FocusFrame& frame);
  /// result: its image is empty when no frame of the bracket could be used.
  void publish(const BracketResult& result, const FusionReportPtr& report, const SharedScene& scene);

 private:
  sensor_msgs::PointCloud2ConstPtr latestPoints() const;

  NodeStatus& status_;
  ros::Publisher image_, weights_, depth_, depth_restored_, source_index_, confidence_, info_, points_,
      report_, progress_;

  /// What a cloud is made of.
  struct Latest {
    sensor_msgs::ImageConstPtr image, depth;
    sensor_msgs::CameraInfoConstPtr camera;
  };
  mutable std::mutex mutex_;  ///< guards what follows
  Latest latest_;
};

}  // namespace all_in_focus
