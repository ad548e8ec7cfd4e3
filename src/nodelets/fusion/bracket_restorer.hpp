// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "node_monitor.hpp"
#include "open_bracket.hpp"

namespace all_in_focus {

/// Restores fused brackets, in a thread of its own, one at a time: fusing never waits for it, and it holds
/// one bracket however many are fused meanwhile. Each bracket that is handed over is passed on once:
/// corrected, or, when it was given up, as it was fused. Methods are for one thread, that of the worker.
class BracketRestorer {
 public:
  using Interrupted = std::function<bool()>;  ///< true: nobody wants any result; from any thread
  /// Takes what is finished, in the restorer's thread.
  using Done = std::function<void(const FusedBracket&, const FrameFates&)>;

  BracketRestorer(NodeMonitor& monitor, Interrupted interrupted, Done done);
  ~BracketRestorer();  ///< what is at work is dropped

  /// bracket.restoration must not be null. The one before must be finished, or given up.
  void start(const FusedBracket& bracket, const FrameFates& fates);
  /// Passes on what is at work as it was fused, for `reason`; returns once it is out.
  void giveUp(const std::string& reason);
  /// Drops what is at work.
  void drop();
  /// Until nothing is at work.
  void wait();
  /// Calls back when nothing is at work: now, or in the restorer's thread.
  void whenIdle(std::function<void()> callback);

  /// While paused, restoration stands still between two of its steps: the processor is for what is fused.
  void setPaused(bool paused);

 private:
  struct Job {
    FusedBracket bracket;
    FrameFates fates;
  };

  void run();
  void restore(FusedBracket& bracket);
  bool proceed(const FusedBracket& bracket, double done);

  NodeMonitor& monitor_;
  const Interrupted interrupted_;
  const Done done_;
  std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  std::optional<Job> job_;  // until it was passed on or dropped
  std::vector<std::function<void()>> callbacks_;
  std::string given_up_;  // why, "" = it was not
  bool dropped_ = false, paused_ = false, stopped_ = false;

  std::thread thread_;
};

}  // namespace all_in_focus
