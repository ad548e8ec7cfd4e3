// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/time.h>

#include <cstdint>
#include <deque>

namespace all_in_focus {

/// Converts the camera's clock to host time: device time plus the least of the last offsets between the two
/// clocks. Arrival times alone jitter with USB and load. Frames arrive late, but never early, so the least
/// offset is the best.
class KinectClock {
 public:
  /// rate: device seconds per host second; other than 1 for recordings only. 0: the clocks are unrelated, and
  /// stamps are arrival times.
  explicit KinectClock(double rate = 1.0) : rate_(rate) {}

  /// Stamps are never later than the arrival, and always later than the last stamp. If either clock is set
  /// back, the offsets are measured anew.
  ros::Time stamp(std::uint64_t device_us, const ros::Time& arrival);

 private:
  double rate_;
  std::deque<double> offsets_;  // host - device, s from epoch_
  ros::Time epoch_;             // first arrival: keeps the numbers small
  std::uint64_t last_device_us_ = 0;
  ros::Time last_arrival_, last_stamp_;
};

}  // namespace all_in_focus
