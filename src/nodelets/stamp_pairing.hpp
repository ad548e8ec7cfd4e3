// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/time.h>

#include <cstddef>
#include <map>
#include <utility>
#include <vector>

namespace all_in_focus {

/// Pairs messages of two topics by equal stamps. message_filters' ExactTime does the same, but where time
/// jumps back (bag loops) its stale entries push new ones out for good, and rebuilding it loses a message
/// that came just before. Messages of one topic come in order; a pair makes everything older that still waits
/// unmatched.
template <typename First, typename Second>
class StampPairing {
 public:
  using Pair = std::pair<First, Second>;  ///< shared pointers, one of them empty while unmatched

  explicit StampPairing(std::size_t limit) : limit_(limit) {}

  /// Messages that will not be paired any more are appended to `unmatched`. True: `pair` is complete.
  bool add(const First& message, Pair& pair, std::vector<Pair>& unmatched) {
    return add(message->header.stamp, &Pair::first, message, pair, unmatched);
  }
  bool add(const Second& message, Pair& pair, std::vector<Pair>& unmatched) {
    return add(message->header.stamp, &Pair::second, message, pair, unmatched);
  }

  /// Time went back to `now`: what is newer is stale.
  void forgetAfter(const ros::Time& now) { waiting_.erase(waiting_.upper_bound(now), waiting_.end()); }
  void clear() { waiting_.clear(); }

 private:
  template <typename Message>
  bool add(const ros::Time& stamp, Message Pair::*member, const Message& message, Pair& pair,
           std::vector<Pair>& unmatched) {
    Pair& entry = waiting_[stamp];
    entry.*member = message;
    if (entry.first && entry.second) {
      pair = entry;
      for (auto it = waiting_.begin(); it->first < stamp; it = waiting_.erase(it))
        unmatched.push_back(it->second);
      waiting_.erase(stamp);
      return true;
    }
    for (; waiting_.size() > limit_; waiting_.erase(waiting_.begin()))
      unmatched.push_back(waiting_.begin()->second);
    return false;
  }

  std::map<ros::Time, Pair> waiting_;
  std::size_t limit_;
};

}  // namespace all_in_focus
