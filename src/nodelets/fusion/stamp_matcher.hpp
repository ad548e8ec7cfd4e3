// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <message_filters/sync_policies/exact_time.h>
#include <message_filters/synchronizer.h>

#include <boost/make_shared.hpp>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "image_limit.hpp"

namespace all_in_focus {

/// Matches the images of one topic with the messages of another that have the same stamp. It uses
/// message_filters' ExactTime, and adds the messages itself instead of connecting subscribers. So it can
/// replace the synchronizer when time jumps back, before it adds the first message of the new time, and it
/// can limit the bytes of waiting images.
template <typename First, typename Second>
class StampMatcher {
 public:
  using FirstPtr = boost::shared_ptr<const First>;
  using SecondPtr = boost::shared_ptr<const Second>;
  using Callback = std::function<void(const FirstPtr&, const SecondPtr&)>;

  /// most: how many stamps may wait. matched: receives pairs. dropped: receives messages that will not be
  /// matched any more; one of its arguments is null.
  StampMatcher(std::size_t most, Callback matched, Callback dropped)
      : most_(most), matched_(std::move(matched)), dropped_(std::move(dropped)) {
    clear();
  }
  StampMatcher(const StampMatcher&) = delete;
  StampMatcher& operator=(const StampMatcher&) = delete;

  /// Whether a message of this stamp waits.
  bool holds(const ros::Time& stamp) const { return stamps_.count(stamp) > 0; }

  void add(const FirstPtr& message) {
    stamps_.insert(message->header.stamp);
    std::size_t& bytes = image_bytes_[message->header.stamp];
    bytes_ += message->data.size() - bytes;
    bytes = message->data.size();
    synchronizer_->template add<0>(message);
    while (bytes_ > kMaxWaitingBytes && image_bytes_.size() > kFewestWaiting) dropOldest();
  }
  void add(const SecondPtr& message) {
    stamps_.insert(message->header.stamp);
    synchronizer_->template add<1>(message);
  }

  /// Call when time went back to `now`: removes newer messages and passes them to `forgotten`, as to
  /// `dropped`.
  void forgetAfter(const ros::Time& now, const Callback& forgotten) {
    if (stamps_.empty()) return;
    // A pair that is newer than everything makes the synchronizer drop all that waits.
    std::vector<std::pair<FirstPtr, SecondPtr>> waiting;
    drained_ = &waiting;
    synchronizer_->template add<0>(stamped<First>(ros::TIME_MAX));
    synchronizer_->template add<1>(stamped<Second>(ros::TIME_MAX));
    drained_ = nullptr;
    clear();
    for (const auto& [first, second] : waiting) {
      if ((first ? first->header.stamp : second->header.stamp) > now) {
        forgotten(first, second);
      } else if (first) {
        add(first);
      } else {
        add(second);
      }
    }
  }

  /// Call when time went back to `now`: drops newer messages.
  void forgetAfter(const ros::Time& now) { forgetAfter(now, dropped_); }

  void clear() {
    synchronizer_ = std::make_unique<Synchronizer>(Policy(static_cast<std::uint32_t>(most_)));
    synchronizer_->registerCallback(&StampMatcher::onMatch, this);
    synchronizer_->registerDropCallback(&StampMatcher::onDrop, this);
    stamps_.clear();
    image_bytes_.clear();
    bytes_ = 0;
  }

 private:
  using Policy = message_filters::sync_policies::ExactTime<First, Second>;
  using Synchronizer = message_filters::Synchronizer<Policy>;

  template <typename Message>
  static boost::shared_ptr<const Message> stamped(const ros::Time& stamp) {
    const auto message = boost::make_shared<Message>();
    message->header.stamp = stamp;
    return message;
  }

  void onMatch(const FirstPtr& first, const SecondPtr& second) {
    if (drained_) return;
    forget(first, second);
    second == eviction_ ? dropped_(first, nullptr) : matched_(first, second);
  }

  void onDrop(const FirstPtr& first, const SecondPtr& second) {
    if (drained_) {
      drained_->emplace_back(first, second);
    } else {
      forget(first, second);
      dropped_(first, second);
    }
  }

  void forget(const FirstPtr& image, const SecondPtr& second) {
    stamps_.erase(image ? image->header.stamp : second->header.stamp);
    if (!image) return;
    const auto found = image_bytes_.find(image->header.stamp);
    if (found == image_bytes_.end()) return;
    bytes_ -= found->second;
    image_bytes_.erase(found);
  }

  // ExactTime limits only the number of messages. An empty partner makes it release the oldest image.
  void dropOldest() {
    eviction_ = stamped<Second>(image_bytes_.begin()->first);
    synchronizer_->template add<1>(eviction_);
  }

  const std::size_t most_;
  const Callback matched_, dropped_;
  std::unique_ptr<Synchronizer> synchronizer_;
  std::set<ros::Time> stamps_;                    // of what waits
  std::map<ros::Time, std::size_t> image_bytes_;  // of the images that wait
  std::size_t bytes_ = 0;                         // their sum
  SecondPtr eviction_;
  std::vector<std::pair<FirstPtr, SecondPtr>>* drained_ = nullptr;  // set while all are being removed
};

}  // namespace all_in_focus
