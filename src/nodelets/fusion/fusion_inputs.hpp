// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FocusFrame.h>
#include <all_in_focus/SegmentArray.h>
#include <image_transport/image_transport.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <cstddef>

#include "fusion_worker.hpp"
#include "node_monitor.hpp"
#include "scene_cache.hpp"
#include "stamp_pairing.hpp"

namespace all_in_focus {

/// What the fusion listens to. Pairs frames with what rgb/focus says of them, and label images with the table
/// of their regions; frames go to the worker, all else to the scene cache.
///
/// Callbacks run on the queue of nh, one after the other; the methods are to be called there, too, or before.
class FusionInputs {
 public:
  /// Adds the inputs to the monitor, subscribes nothing.
  FusionInputs(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, NodeMonitor& monitor,
               SceneCache& scenes, FusionWorker& worker);

  void subscribe(int queue_size);
  void unsubscribe();
  bool subscribed() const { return static_cast<bool>(image_subscriber_); }

  /// Whether depth before hole filling is of use: not in mode paper.
  void needMeasured(bool needed);

 private:
  using FramePairing = StampPairing<sensor_msgs::ImageConstPtr, FocusFrameConstPtr>;
  using LabelPairing = StampPairing<sensor_msgs::ImageConstPtr, SegmentArrayConstPtr>;

  void updateMeasured();
  void arrived(int input, const ros::Time& stamp, bool is_frame = false);
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onFocus(const FocusFrameConstPtr& focus);
  void onLabels(const sensor_msgs::ImageConstPtr& labels);
  void onSegments(const SegmentArrayConstPtr& segments);
  void onDepth(const sensor_msgs::ImageConstPtr& depth);
  void onMeasured(const sensor_msgs::ImageConstPtr& measured);
  void onInfo(const sensor_msgs::CameraInfoConstPtr& info);
  template <typename Message>
  void pairFrame(const Message& message);
  template <typename Message>
  void pairLabels(const Message& message);

  ros::NodeHandle nh_, private_nh_;
  NodeMonitor& monitor_;
  SceneCache& scenes_;
  FusionWorker& worker_;
  const int image_input_, focus_input_, info_input_, labels_input_, segments_input_, depth_input_,
      measured_input_;

  int queue_size_ = 1;
  bool needs_measured_ = false;
  image_transport::ImageTransport transport_;
  image_transport::Subscriber image_subscriber_;
  ros::Subscriber focus_subscriber_, info_subscriber_, labels_subscriber_, segments_subscriber_,
      depth_subscriber_, measured_subscriber_;
  FramePairing frame_pairing_;
  LabelPairing label_pairing_;
  bool focus_seen_ = false, awaited_ = false;  // since the subscription
};

}  // namespace all_in_focus
