// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <mutex>
#include <shared_mutex>

namespace all_in_focus {

/// Keeps callbacks from running after their object is destroyed. To shut down a subscriber, timer, service or
/// publisher is not enough, because ros::CallbackQueue::removeByID() does not wait for a callback that is
/// running. Callbacks hold the gate by a shared pointer. A callback must not call another one through the
/// same gate. Thread-safe.
class CallbackGate {
 public:
  /// Calls the function unless the gate is closed.
  template <typename Call>
  void run(const Call& call) {
    std::shared_lock<std::shared_mutex> lock(running_);
    if (!closed_) call();
  }

  /// Closes the gate and waits for running calls. Must not be called from one of them, which would wait for
  /// itself.
  void close() {
    closed_ = true;
    std::lock_guard<std::shared_mutex> lock(running_);
  }

 private:
  std::shared_mutex running_;  // held, shared, by running calls
  std::atomic<bool> closed_{false};
};

}  // namespace all_in_focus
