// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/time.h>

#include <functional>
#include <map>
#include <mutex>
#include <utility>

namespace all_in_focus {

/// Seconds from one time to another. The operators of ros::Time throw where a result leaves their range, and
/// the stamp of a message may be anything.
double secondsBetween(const ros::Time& from, const ros::Time& to);

/// Throws std::invalid_argument for a stamp that no clock gives: after the year 2100, or with nanoseconds
/// beyond a second.
void requirePossible(const ros::Time& stamp);

/// Detects that time jumped back (a bag in a loop, a clock that was set), by ros::Time::now() and by the
/// stamps of each input. One jump shows on several inputs, one after the other, and counts once. Thread-safe.
class TimeJumps {
 public:
  struct Arrival {
    bool jumped = false;    ///< this message is the first that shows a jump: empty all caches, then use it
    bool leftover = false;  ///< it was sent before the last jump and arrived after it
    bool unclear = false;   ///< maybe a leftover: the last jump was so short that stamps do not show it
  };

  /// report: called at each jump, with the input that showed it.
  explicit TimeJumps(std::function<void(int input)> report) : report_(std::move(report)) {}

  /// Call first for every message. input: any number that tells the inputs apart.
  Arrival arrived(int input, const ros::Time& stamp);

 private:
  struct Input {
    ros::Time newest;  // stamp since the last jump
    ros::Time before;  // newest stamp before the last jump, until something newer arrives
  };

  const std::function<void(int input)> report_;
  std::mutex mutex_;  // guards all below
  std::map<int, Input> inputs_;
  ros::Time last_now_;
  bool is_short_ = false;    // the last jump
  bool clock_lags_ = false;  // stamps jumped, /clock is still to follow
};

}  // namespace all_in_focus
