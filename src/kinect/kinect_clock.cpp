// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "kinect_clock.hpp"

#include <algorithm>
#include <cmath>

namespace all_in_focus {
namespace {

// Offsets kept: five seconds at 30 Hz. Load delays all images of a second; 100 ppm of drift are 0.5 ms in
// that time.
constexpr std::size_t kWindow = 150;
constexpr double kJump = 1.0;  // s; an offset that changes by more means another time base, not a late frame
const ros::Duration kHostJump(0.5);
const ros::Duration kTick(0, 1000);

double least(const std::deque<double>& values) {
  return *std::min_element(values.begin(), values.end());
}

}  // namespace

ros::Time KinectClock::stamp(std::uint64_t device_us, const ros::Time& arrival) {
  if (arrival + kHostJump < last_arrival_) {
    offsets_.clear();
    last_stamp_ = ros::Time();
  }
  last_arrival_ = arrival;

  ros::Time stamp = arrival;
  if (rate_ > 0) {
    if (device_us < last_device_us_) offsets_.clear();
    last_device_us_ = device_us;
    if (offsets_.empty()) epoch_ = arrival;
    const double device = static_cast<double>(device_us) * 1e-6 / rate_;
    const double offset = (arrival - epoch_).toSec() - device;
    if (!offsets_.empty() && std::abs(offset - least(offsets_)) > kJump) {
      offsets_.assign(1, offset);
    } else {
      offsets_.push_back(offset);
    }
    if (offsets_.size() > kWindow) offsets_.pop_front();
    stamp = std::min(arrival, epoch_ + ros::Duration(device + least(offsets_)));
  }
  if (!last_stamp_.isZero()) stamp = std::max(stamp, last_stamp_ + kTick);
  last_stamp_ = stamp;
  return stamp;
}

}  // namespace all_in_focus
