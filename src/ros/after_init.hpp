// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/ros.h>

#include <functional>
#include <string>

#include "callback_guard.hpp"

namespace all_in_focus {

/// Calls a function of a nodelet once, in a callback. nodelet 1.10.1 drops callbacks while onInit() runs, so
/// there the call comes after it. What is subscribed in onInit() loses the latched messages of a topic to
/// which another nodelet of the process has subscribed already.
class AfterInit {
 public:
  /// To be called in onInit(). nh: of the nodelet; place: begins the message of an error.
  void call(const ros::NodeHandle& nh, const CallbackGuard& guard, const std::string& place,
            const std::function<void()>& function) {
    const auto once = [this, function](const ros::WallTimerEvent&) {
      timer_.stop();
      function();
    };
    constexpr double kPeriod = 0.02;  // s
    timer_ = nh.createWallTimer(ros::WallDuration(kPeriod), guard.wrap(place, once), /*oneshot=*/false,
                                /*autostart=*/false);  // `once` needs timer_
    timer_.start();
  }

 private:
  ros::WallTimer timer_;
};

}  // namespace all_in_focus
