// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <image_transport/image_transport.h>

#include <cstddef>
#include <functional>
#include <mutex>
#include <string>

#include "acknowledger.hpp"
#include "callback_guard.hpp"
#include "waiting_list.hpp"

namespace all_in_focus {

/// Subscribes to images that take long to process. They are received at once, wait here, and are processed
/// one after the other among the guard's other callbacks. Where the node cannot keep up the oldest
/// are dropped, counted and acknowledged; roscpp's own queue would drop them silently.
class ImageQueue {
 public:
  using Callback = std::function<void(const sensor_msgs::ImageConstPtr&)>;

  /// guard: of the nodelet, stopped before this is destroyed. input: the number of the topic in the monitor.
  /// process: gets the images.
  ImageQueue(std::size_t size, Acknowledger& monitor, CallbackGuard& guard, int input, Callback process);

  void subscribe(const std::string& topic);
  void shutdown();  ///< unsubscribes and drops the waiting images
  explicit operator bool() const { return static_cast<bool>(subscriber_); }

 private:
  void push(const sensor_msgs::ImageConstPtr& image);
  void processOldest();

  Acknowledger& monitor_;
  CallbackGuard& guard_;
  const Callback process_;
  const boost::function<void(const sensor_msgs::ImageConstPtr&)> on_image_;
  const std::function<void()> on_turn_;
  std::mutex mutex_;  // guards the two below
  bool open_ = false;
  WaitingList<sensor_msgs::ImageConstPtr> waiting_;  // for each one call in the guard's queue
  image_transport::Subscriber subscriber_;
};

}  // namespace all_in_focus
