// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <std_msgs/Header.h>

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/region_captions.hpp"
#include "callback_guard.hpp"
#include "conversions.hpp"
#include "node_status.hpp"

namespace all_in_focus {

/// Captions of a label image.
struct CaptionSet {
  std_msgs::Header header;  ///< of the label image
  cv::Size size;            ///< of the label image
  int labels = 0;           ///< how many there are, captioned or not: sets the colours
  std::vector<RegionCaption> captions;
};

/// Publishes the captions as text in space for rviz. Each lies on the ray of its anchor, at the near end of
/// its region, because farther back the points of the region would hide it. The rays are computed from the
/// camera_info beside the depth image, which is subscribed to while anybody wants markers. For one thread.
class SegmentMarkers {
 public:
  SegmentMarkers(CallbackGuard& guard, NodeStatus& status);
  /// connect: called when subscribers come or go.
  void advertise(const ros::SubscriberStatusCallback& connect);

  bool wanted() const { return publisher_.getNumSubscribers() > 0; }
  /// Subscribes to the camera_info if markers are wanted and `awake` is true, else unsubscribes.
  void listen(bool awake);

  /// Publishes them, or keeps them until the camera is known: its message may come after the image.
  void publish(const CaptionSet& captions);

 private:
  void onInfo(const sensor_msgs::CameraInfoConstPtr& info);
  bool publishWaiting();

  CallbackGuard& guard_;
  NodeStatus& status_;
  const int info_input_;
  ros::Publisher publisher_;

  std::unique_ptr<Camera> camera_;
  std::unique_ptr<CaptionSet> waiting_;  // the newest, for the camera

  ros::Subscriber info_subscriber_;
};

}  // namespace all_in_focus
