// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FocusFrame.h>
#include <all_in_focus/SegmentArray.h>
#include <image_transport/subscriber.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <optional>

#include "callback_guard.hpp"
#include "frame_queue.hpp"
#include "node_status.hpp"
#include "scene_cache.hpp"
#include "stamp_matcher.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {

/// The subscriptions of the fusion. Matches frames with their messages from rgb/focus, and label images with
/// the tables of their regions. Frames go to the queue, everything else goes to the scene cache.
///
/// Callbacks run one after the other; the methods are to be called from one of them, or before the first.
class FusionInputs {
 public:
  /// Adds the inputs to the status, subscribes nothing.
  FusionInputs(CallbackGuard& guard, NodeStatus& status, SceneCache& scenes, FrameQueue& frames);

  void subscribe();
  void unsubscribe();
  bool subscribed() const { return static_cast<bool>(image_subscriber_); }

  /// Sets whether depth before hole filling is needed; mode paper does not need it.
  void needMeasured(bool needed);

 private:
  template <typename Message, typename Use>
  ros::Subscriber subscribeTo(int input, std::uint32_t queue_size, Use use);
  void updateMeasured();
  TimeJumps::Arrival noticeJump(int input, const ros::Time& stamp, bool is_frame = false);
  bool isLate(const TimeJumps::Arrival& arrival, const ros::Time& stamp);
  void addFrame(const BracketFrame& frame);
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onFocus(const FocusFrameConstPtr& focus);
  void onLabelSet(const sensor_msgs::ImageConstPtr& labels, const SegmentArrayConstPtr& segments);
  void onUnmatchedFrame(const sensor_msgs::ImageConstPtr& image, const char* reason);

  CallbackGuard& guard_;
  NodeStatus& status_;
  SceneCache& scenes_;
  FrameQueue& frames_;
  const int image_input_, focus_input_, info_input_, labels_input_, segments_input_, depth_input_,
      measured_input_;
  TimeJumps time_jumps_;
  using FrameMatcher = StampMatcher<sensor_msgs::Image, FocusFrame>;
  FrameMatcher frame_matcher_;
  FrameMatcher late_matcher_;  // of frames from before time jumped back
  StampMatcher<sensor_msgs::Image, SegmentArray> label_matcher_;

  bool needs_measured_ = false;
  bool unclear_ = false;                            // it is unknown which frames are older than the last jump
  bool focus_seen_ = false, awaited_ = false;       // since the subscription
  std::optional<std::uint32_t> announced_bracket_;  // the last one of rgb/focus
  image_transport::Subscriber image_subscriber_;
  ros::Subscriber focus_subscriber_, info_subscriber_, labels_subscriber_, segments_subscriber_,
      depth_subscriber_, measured_subscriber_;
};

}  // namespace all_in_focus
