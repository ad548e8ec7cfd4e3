// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <mutex>

namespace all_in_focus {

/// Stands around callbacks that must not run after their object is gone. Shutting a subscriber, timer,
/// service or publisher down does not promise that: ros::CallbackQueue::removeByID() does not wait for a
/// callback under way. Callbacks hold the gate by a shared pointer. Thread-safe.
class CallbackGate {
 public:
  /// Calls it, unless the gate is closed.
  template <typename Call>
  void run(const Call& call) {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      if (closed_) return;
      ++running_;
    }
    const Leaving leaving{*this};
    call();
  }

  /// Waits for calls under way; after it there is none. Not to be called by one of them.
  void close() {
    std::unique_lock<std::mutex> lock(mutex_);
    closed_ = true;
    ended_.wait(lock, [this] { return running_ == 0; });
  }

 private:
  struct Leaving {
    CallbackGate& gate;
    ~Leaving() {
      std::lock_guard<std::mutex> lock(gate.mutex_);
      --gate.running_;
      gate.ended_.notify_all();
    }
  };

  std::mutex mutex_;  // guards all below
  std::condition_variable ended_;
  int running_ = 0;
  bool closed_ = false;
};

}  // namespace all_in_focus
