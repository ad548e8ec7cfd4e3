// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ros/time.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

namespace all_in_focus {

/// Pairs messages of two topics by equal stamps. message_filters' ExactTime does the same, but where time
/// jumps back (bag loops) its stale entries push new ones out for good, and rebuilding it loses a message
/// that came just before. Messages of one topic come in order; a pair makes everything older that still waits
/// unmatched, but what came after it: that is new, and the pair from before a jump back.
template <typename First, typename Second>
class StampPairing {
 public:
  using Pair = std::pair<First, Second>;  ///< shared pointers, one of them empty while unmatched

  explicit StampPairing(std::size_t limit) : limit_(limit) {}

  /// Messages that will not be paired any more are appended to `unmatched`. True: `pair` is complete.
  bool add(const First& message, Pair& pair, std::vector<Pair>& unmatched) {
    return add(message->header.stamp, &Pair::first, &Waiting::first_arrival, message, pair, unmatched);
  }
  bool add(const Second& message, Pair& pair, std::vector<Pair>& unmatched) {
    return add(message->header.stamp, &Pair::second, &Waiting::second_arrival, message, pair, unmatched);
  }

  /// Time went back to `now`: what is newer is stale.
  void forgetAfter(const ros::Time& now) { waiting_.erase(waiting_.upper_bound(now), waiting_.end()); }
  void clear() { waiting_.clear(); }

 private:
  struct Waiting {
    Pair pair;
    std::uint64_t first_arrival = 0, second_arrival = 0;  // arrivals are counted

    bool cameBefore(const Waiting& other) const {
      return pair.first ? first_arrival < other.first_arrival : second_arrival < other.second_arrival;
    }
  };

  template <typename Message>
  bool add(const ros::Time& stamp, Message Pair::*member, std::uint64_t Waiting::*arrival,
           const Message& message, Pair& pair, std::vector<Pair>& unmatched) {
    Waiting& entry = waiting_[stamp];
    entry.pair.*member = message;
    entry.*arrival = ++arrivals_;
    if (entry.pair.first && entry.pair.second) {
      pair = entry.pair;
      for (auto it = waiting_.begin(); it->first < stamp;) {
        const auto older = it++;
        if (!older->second.cameBefore(entry)) continue;
        unmatched.push_back(older->second.pair);
        waiting_.erase(older);
      }
      waiting_.erase(stamp);
      return true;
    }
    for (; waiting_.size() > limit_; waiting_.erase(waiting_.begin()))
      unmatched.push_back(waiting_.begin()->second.pair);
    return false;
  }

  std::map<ros::Time, Waiting> waiting_;
  std::uint64_t arrivals_ = 0;
  std::size_t limit_;
};

}  // namespace all_in_focus
