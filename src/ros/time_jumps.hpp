// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/time.h>

namespace all_in_focus {

/// Seconds from one time to another. The operators of ros::Time throw where a result leaves their range, and
/// the stamp of a message may be anything.
double secondsBetween(const ros::Time& from, const ros::Time& to);

/// Throws std::invalid_argument for a stamp that no clock gives: after the year 2100, or with nanoseconds
/// beyond a second.
void requirePossible(const ros::Time& stamp);

/// Notices that time went back (a bag in a loop, a clock that was set): by ros::Time::now(), and by the
/// stamps of the one stream that sets the pace of a node.
class TimeJumps {
 public:
  /// By how much stamps may go back while time does not, s.
  void setTolerance(double tolerance_s) { tolerance_s_ = tolerance_s; }

  /// Call for every message of other streams, before it is used. True: the clock went back since the last
  /// message.
  bool clockWentBack(const ros::Time& now = ros::Time::now());
  /// Call for every message of the stream, before it is used. True: the clock or the stamps went back. A
  /// stamp ahead of the clock counts as now: it may be from before the clock jumped.
  bool streamWentBack(const ros::Time& stamp);

 private:
  double tolerance_s_ = 1;
  ros::Time last_now_;
  ros::Time newest_;         // stamp since the last jump
  bool clock_lags_ = false;  // the stream went back, /clock is still to follow: the same jump
};

}  // namespace all_in_focus
