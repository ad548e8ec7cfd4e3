// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <image_transport/image_transport.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>

#include <functional>
#include <mutex>
#include <string>

#include "node_monitor.hpp"
#include "open_bracket.hpp"

namespace all_in_focus {

/// What the fusion publishes, all of one result with one header and latched. publish() and setCameraInfo()
/// may be called from different threads.
class FusionOutputs {
 public:
  /// connect is called whenever a subscriber comes or goes, maybe before this returns: hold the mutex it
  /// takes.
  void advertise(ros::NodeHandle& nh, image_transport::ImageTransport& transport, NodeMonitor& monitor,
                 const std::function<void()>& connect);
  /// Somebody listens.
  bool wanted() const;
  void setCameraInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void publish(const FusedBracket& bracket);

 private:
  /// image_transport's own latch forgets what is published while nobody listens to that topic.
  struct LatchedImage {
    image_transport::Publisher publisher;
    sensor_msgs::ImageConstPtr last;
  };

  void publish(LatchedImage& output, const sensor_msgs::ImageConstPtr& message);
  void publishDepth(const std_msgs::Header& header, const sensor_msgs::ImageConstPtr& depth,
                    const cv::Size& size);

  NodeMonitor* monitor_ = nullptr;
  LatchedImage image_, weights_, depth_;
  ros::Publisher source_index_, info_, report_;
  std::mutex mutex_;  // guards camera_info_ and what is latched
  sensor_msgs::CameraInfoConstPtr camera_info_;
};

}  // namespace all_in_focus
