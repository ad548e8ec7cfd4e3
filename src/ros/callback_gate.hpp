// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <mutex>
#include <shared_mutex>

namespace all_in_focus {

/// Stands around callbacks that must not run after their object is gone. Shutting a subscriber, timer,
/// service or publisher down does not promise that: ros::CallbackQueue::removeByID() does not wait for a
/// callback under way. Callbacks hold the gate by a shared pointer. A call must not run another one.
/// Thread-safe.
class CallbackGate {
 public:
  /// Calls it, unless the gate is closed.
  template <typename Call>
  void run(const Call& call) {
    std::shared_lock<std::shared_mutex> lock(running_);
    if (!closed_) call();
  }

  /// Waits for calls under way; after it there is none. Not to be called by one of them.
  void close() {
    closed_ = true;
    std::lock_guard<std::shared_mutex> lock(running_);
  }

 private:
  std::shared_mutex running_;  // shared by the calls under way
  std::atomic<bool> closed_{false};
};

}  // namespace all_in_focus
