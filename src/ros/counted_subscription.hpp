// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <image_transport/image_transport.h>
#include <ros/callback_queue_interface.h>

#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <string>

#include "node_monitor.hpp"

namespace all_in_focus {

/// Images for a nodelet's own queue, the newest ones. Where a node cannot keep up roscpp would drop the
/// others as well, but tells nobody: so they arrive on another thread, wait here, and what is dropped is
/// counted.
class CountedSubscription {
 public:
  using Callback = std::function<void(const sensor_msgs::ImageConstPtr&)>;

  /// process: called on `worker` for one image after the other. Of more than `size` (at least 1) that wait
  /// the oldest is dropped, and the monitor told.
  CountedSubscription(ros::CallbackQueueInterface& worker, std::size_t size, NodeMonitor& monitor,
                      Callback process);
  ~CountedSubscription();  ///< a running process() ends first
  CountedSubscription(const CountedSubscription&) = delete;
  CountedSubscription& operator=(const CountedSubscription&) = delete;

  /// nh: the multi-threaded one, whose threads never wait for process(). private_nh: has the transport's
  /// name.
  void subscribe(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const std::string& topic);
  void shutdown();  ///< and forgets what waits
  explicit operator bool() const { return static_cast<bool>(subscriber_); }

 private:
  class Call;
  void push(const sensor_msgs::ImageConstPtr& image);
  void processOldest();

  ros::CallbackQueueInterface& worker_;
  const std::size_t size_;
  NodeMonitor& monitor_;
  const Callback process_;
  std::mutex mutex_;
  std::deque<sensor_msgs::ImageConstPtr> waiting_;  // oldest first; for each a call in worker_
  image_transport::Subscriber subscriber_;
};

}  // namespace all_in_focus
