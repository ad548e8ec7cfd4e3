// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "time_jumps.hpp"

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>

namespace all_in_focus {
namespace {

constexpr double kClockJitter = 0.1;  // s that ros::Time::now() may go back, as NTP corrects it
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

bool TimeJumps::clockWentBack(const ros::Time& now) {
  const bool went_back = secondsBetween(now, last_now_) > kClockJitter;
  last_now_ = now;
  if (!went_back || std::exchange(clock_lags_, false)) return false;
  newest_ = ros::Time();
  return true;
}

bool TimeJumps::streamWentBack(const ros::Time& stamp) {
  const ros::Time now = ros::Time::now();
  bool went_back = clockWentBack(now);
  if (stamp.isZero()) return went_back;
  if (secondsBetween(stamp, newest_) > tolerance_s_) {
    clock_lags_ = !went_back && ros::Time::isSimTime();
    went_back = true;
    newest_ = ros::Time();
  }
  newest_ = std::max(newest_, std::min(stamp, now));
  return went_back;
}

}  // namespace all_in_focus
