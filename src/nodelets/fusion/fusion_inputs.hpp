// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FocusFrame.h>
#include <all_in_focus/SegmentArray.h>
#include <image_transport/subscriber.h>
#include <message_filters/sync_policies/exact_time.h>
#include <message_filters/synchronizer.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <vector>

#include "callback_guard.hpp"
#include "fusion_worker.hpp"
#include "node_status.hpp"
#include "scene_cache.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {

/// The subscriptions of the fusion. Matches frames with their messages from rgb/focus. Frames go to the
/// worker, everything else goes to the scene cache.
///
/// Callbacks are quick ones of the guard; the methods are to be called from one of them, or while none runs.
class FusionInputs {
 public:
  /// Adds the inputs to the status, subscribes nothing.
  FusionInputs(CallbackGuard& guard, NodeStatus& status, SceneCache& scenes, FusionWorker& worker);

  void subscribe();
  void unsubscribe();
  bool subscribed() const { return static_cast<bool>(image_subscriber_); }

  /// gap_s: stamps of colour frames that go back by more tell that time went back; 0 = 1 s.
  void configure(double gap_s);

 private:
  using ExactTime = message_filters::sync_policies::ExactTime<sensor_msgs::Image, FocusFrame>;
  using Matcher = message_filters::Synchronizer<ExactTime>;

  template <typename Message, typename Use>
  void subscribeTo(int input, std::uint32_t queue_size, Use use);
  void settle();
  bool isAnnounced(const sensor_msgs::Image& image) const;
  void updatePublished(bool assumed);
  void startAfresh(int input, const ros::Time& now);

  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onFocus(const FocusFrameConstPtr& focus);
  void onOptics(const OpticsConstPtr& optics);
  void onLabels(const sensor_msgs::ImageConstPtr& labels);
  void addPlain(const sensor_msgs::ImageConstPtr& image);
  void onFrame(const sensor_msgs::ImageConstPtr& image, const FocusFrameConstPtr& focus);
  void restartMatcher();
  void giveUpImages(std::size_t count);
  void giveUpAllImages();
  void warnOfMismatch();
  int inputOf(SceneTopic topic) const { return scene_inputs_[static_cast<std::size_t>(topic)]; }

  CallbackGuard& guard_;
  NodeStatus& status_;
  SceneCache& scenes_;
  FusionWorker& worker_;
  const int image_input_, focus_input_, segments_input_;
  const std::array<int, kSceneTopics> scene_inputs_;  // by SceneTopic
  TimeJumps time_jumps_;

  std::unique_ptr<Matcher> matcher_;                  // image + rgb/focus
  std::deque<sensor_msgs::ImageConstPtr> images_;     // that it has not matched, from the oldest on
  std::chrono::steady_clock::time_point last_match_;  // or since when there is something to match

  bool settled_ = false;  // all publishers have had time to connect since the first frame
  ros::WallTimer settling_;
  ros::WallTime settle_until_;
  ros::Time last_focus_, last_frame_;  // stamps: of rgb/focus; of that or a frame without it
  image_transport::Subscriber image_subscriber_;
  std::vector<ros::Subscriber> subscribers_;  // all others
};

}  // namespace all_in_focus
