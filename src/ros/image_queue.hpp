// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <image_transport/image_transport.h>
#include <ros/callback_queue_interface.h>

#include <cstddef>
#include <functional>
#include <mutex>
#include <string>

#include "acknowledger.hpp"
#include "callback_guard.hpp"
#include "waiting_list.hpp"

namespace all_in_focus {

/// Subscribes to images that take long to process. They are received on the multi-threaded queue, wait here,
/// and are processed one after the other on the nodelet's own queue. Where the node cannot keep up the oldest
/// are dropped, counted and acknowledged; roscpp's own queue would drop them silently.
class ImageQueue {
 public:
  using Callback = std::function<void(const sensor_msgs::ImageConstPtr&)>;

  /// own_queue: the nodelet's. guard: of the nodelet, closed before this is destroyed. input: the number of
  /// the topic in the monitor. process: gets the images.
  ImageQueue(ros::CallbackQueueInterface& own_queue, std::size_t size, Acknowledger& monitor,
             const CallbackGuard& guard, int input, Callback process);

  /// nh: the multi-threaded one. private_nh: has the name of the transport.
  void subscribe(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const std::string& topic);
  void shutdown();  ///< unsubscribes and drops the waiting images
  explicit operator bool() const { return static_cast<bool>(subscriber_); }

 private:
  void push(const sensor_msgs::ImageConstPtr& image);
  void processOldest();

  ros::CallbackQueueInterface& own_queue_;
  Acknowledger& monitor_;
  const Callback process_;
  const boost::function<void(const sensor_msgs::ImageConstPtr&)> on_image_;
  const std::function<void()> on_turn_;
  std::mutex mutex_;  // guards the two below
  bool open_ = false;
  WaitingList<sensor_msgs::ImageConstPtr> waiting_;  // for each one call in own_queue_
  image_transport::Subscriber subscriber_;
};

}  // namespace all_in_focus
