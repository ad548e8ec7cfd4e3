// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "time_jumps.hpp"

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace all_in_focus {
namespace {

constexpr double kJitter = 0.1;    // s that stamps may go back while time does not
constexpr double kUnderWay = 1.0;  // s that a message of before a jump is newer than the last one, at most
constexpr std::uint32_t kYear2100 = 4102444800;
constexpr std::uint32_t kNanoseconds = 1000000000;

}  // namespace

double secondsBetween(const ros::Time& from, const ros::Time& to) {
  const auto nanoseconds = [](const ros::Time& time) { return static_cast<std::int64_t>(time.toNSec()); };
  return static_cast<double>(nanoseconds(to) - nanoseconds(from)) * 1e-9;
}

void requirePossible(const ros::Time& stamp) {
  if (stamp.sec < kYear2100 && stamp.nsec < kNanoseconds) return;
  throw std::invalid_argument("stamp " + std::to_string(stamp.sec) + " s " + std::to_string(stamp.nsec) +
                              " ns is impossible: check the clock of its publisher");
}

TimeJumps::Arrival TimeJumps::arrived(int input, const ros::Time& stamp) {
  std::lock_guard<std::mutex> lock(mutex_);
  Input& in = inputs_[input];
  const ros::Time now = ros::Time::now();
  const double clock_back = secondsBetween(now, last_now_);
  const double stamp_back = stamp.isZero() ? 0 : secondsBetween(stamp, in.newest);
  last_now_ = now;

  Arrival arrival;
  bool clock_jumped = clock_back > kJitter;
  if (clock_jumped && clock_lags_) clock_jumped = clock_lags_ = false;
  if (clock_jumped || stamp_back > kJitter) {
    arrival.jumped = true;
    clock_lags_ = !clock_jumped && ros::Time::isSimTime();
    is_short_ = std::max(clock_back, stamp_back) <= kUnderWay;  // old and new stamps overlap
    for (auto& [number, each] : inputs_) {
      if (!each.newest.isZero()) each.before = is_short_ ? ros::Time() : each.newest;
      each.newest = ros::Time();
    }
    report_(input);
  }
  arrival.unclear = is_short_;
  if (stamp.isZero()) return arrival;

  const double newer = secondsBetween(in.before, stamp);
  arrival.leftover = !in.before.isZero() && newer > -kJitter && newer < kUnderWay;
  if (!arrival.leftover) in.before = ros::Time();
  const bool ahead_of_clock = ros::Time::isSimTime() && secondsBetween(now, stamp) > kJitter;
  if (!arrival.leftover && !ahead_of_clock) in.newest = std::max(in.newest, stamp);
  return arrival;
}

}  // namespace all_in_focus
