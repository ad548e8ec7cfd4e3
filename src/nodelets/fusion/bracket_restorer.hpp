// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "node_status.hpp"
#include "open_bracket.hpp"

namespace all_in_focus {

/// Restores fused brackets in a thread of its own, one at a time. Fusion never waits for it, and it holds
/// only one bracket, however many are fused in the meantime. It passes on each bracket that it was given
/// once: restored, or, if restoration was given up, as it was fused. Call all methods from the worker's
/// thread.
class BracketRestorer {
 public:
  using Interrupted = std::function<bool()>;  ///< true: nobody wants a result; called from any thread
  /// Receives finished brackets in the restorer's thread.
  using Done = std::function<void(const FusedBracket&, const FrameFates&)>;

  BracketRestorer(NodeStatus& status, Interrupted interrupted, Done done);
  ~BracketRestorer();  ///< drops the bracket that is being restored

  /// Starts to restore a bracket; its `restoration` must not be null. The bracket before must be finished or
  /// given up.
  void start(const FusedBracket& bracket, const FrameFates& fates);
  /// Stops restoring and passes the bracket on as it was fused, with `reason` in its report. Returns when
  /// that is done.
  void giveUp(const std::string& reason);
  /// Stops restoring and drops the bracket.
  void drop();
  /// Waits until no bracket is being restored.
  void wait();
  /// Calls back when no bracket is being restored: at once, or later in the restorer's thread.
  void whenIdle(std::function<void()> callback);

  /// While paused, restoration waits between two of its steps, so that fusion has the processor.
  void setPaused(bool paused);

 private:
  struct Job {
    FusedBracket bracket;
    FrameFates fates;
  };

  void run();
  void restore(FusedBracket& bracket);
  bool proceed(const FusedBracket& bracket, double done);

  NodeStatus& status_;
  const Interrupted interrupted_;
  const Done done_;
  std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  std::optional<Job> job_;  // until it was passed on or dropped
  std::vector<std::function<void()>> callbacks_;
  std::string given_up_;  // the reason; "" = it was not given up
  bool dropped_ = false, paused_ = false, stopped_ = false;

  std::thread thread_;
};

}  // namespace all_in_focus
