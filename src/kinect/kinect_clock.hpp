// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/time.h>

#include <cstdint>
#include <deque>

namespace all_in_focus {

/// Stamps in the host's time that keep the even pace of the camera's clock: device time plus the median of
/// the last offsets between both. Arrival alone jitters with USB and load; the median ignores frames that
/// came late.
class KinectClock {
 public:
  /// rate: device seconds in a host second, other than 1 for recordings. At 0 there is no relation, and
  /// stamps are arrival times.
  explicit KinectClock(double rate = 1.0) : rate_(rate) {}

  /// Never after the arrival, never at or before the last stamp. A clock that was set back on either side
  /// starts afresh.
  ros::Time stamp(std::uint64_t device_us, const ros::Time& arrival);

 private:
  double rate_;
  std::deque<double> offsets_;  // host - device, s from epoch_
  ros::Time epoch_;             // first arrival: keeps the numbers small
  std::uint64_t last_device_us_ = 0;
  ros::Time last_arrival_, last_stamp_;
};

}  // namespace all_in_focus
