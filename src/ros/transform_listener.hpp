// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>

#include <string>

#include "callback_guard.hpp"
#include "time_jumps.hpp"

namespace all_in_focus {

/// Fills a tf2 buffer from /tf and /tf_static, as tf2_ros::TransformListener does. A transform with an
/// impossible stamp would end that one and the whole process; here it is refused and reported.
class TransformListener {
 public:
  TransformListener(ros::NodeHandle nh, tf2_ros::Buffer& buffer, const CallbackGuard& guard)
      : buffer_(buffer) {
    // Uses the queue of the process instead of the nodelet's, of which nodelet 1.10.1 drops all callbacks
    // while onInit() runs: a static transform comes only once.
    nh.setCallbackQueue(ros::getGlobalCallbackQueue());
    constexpr std::uint32_t kQueueSize = 100;
    const auto subscribe = [&](const std::string& topic, bool is_static) {
      using Callback = boost::function<void(const tf2_msgs::TFMessageConstPtr&)>;
      return nh.subscribe<tf2_msgs::TFMessage>(
          topic, kQueueSize,
          Callback(guard.wrap(topic, [this, is_static](const tf2_msgs::TFMessageConstPtr& message) {
            add(*message, is_static);
          })));
    };
    moving_ = subscribe("/tf", false);
    static_ = subscribe("/tf_static", true);
  }

 private:
  void add(const tf2_msgs::TFMessage& message, bool is_static) {
    const ros::Time now = ros::Time::now();
    if (now < last_) buffer_.clear();  // time went back: all moving transforms are out of date
    last_ = now;
    for (const geometry_msgs::TransformStamped& transform : message.transforms) {
      requirePossible(transform.header.stamp);
      buffer_.setTransform(transform, "all_in_focus", is_static);
    }
  }

  tf2_ros::Buffer& buffer_;
  ros::Time last_;
  ros::Subscriber moving_, static_;
};

}  // namespace all_in_focus
