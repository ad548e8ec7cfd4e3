// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FocusFrame.h>
#include <sensor_msgs/Image.h>

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "bracket_assembler.hpp"
#include "node_status.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {

/// A colour frame and its message from rgb/focus, if there is one.
struct BracketFrame {
  sensor_msgs::ImageConstPtr image;
  FocusFrameConstPtr focus;
};

/// What the worker is to do next.
struct FusionTask {
  enum class Kind {
    kFrame,    ///< a frame of the open bracket; step.begin: the first of a new one; step.last: the last
    kEnd,      ///< the open bracket has ended
    kFinish,   ///< set `finished`
    kAbandon,  ///< nobody wants the open bracket any more
  };
  Kind kind = Kind::kFrame;
  int missing = 0;                                ///< kEnd: frames of the bracket that never came
  std::shared_ptr<std::promise<int>> finished{};  ///< kFinish
  // kFrame:
  BracketFrame frame{};  ///< without an image: it was dropped to make room for newer ones
  std_msgs::Header header{};
  std::size_t bytes = 0;  ///< of the image
  BracketAssembler::Step step{};
};

/// Colour frames that wait for the worker. Finds where brackets begin and end while frames arrive. When too
/// many wait, by number or by bytes, the oldest images are dropped; their frames stay, so that every bracket
/// that began is reported. All methods are thread-safe and return at once, but take().
class FrameQueue {
 public:
  /// scenes: keeps the scene of each bracket that begins.
  FrameQueue(NodeStatus& status, SceneCache& scenes) : status_(status), scenes_(scenes) {}

  /// most: images that may wait.
  void configure(const BracketConfig& config, std::size_t most);

  enum class Time {
    kNow,
    kBefore,  ///< sent before time went back: used only if the bracket that was open then lacks it
    kUnclear  ///< unknown: kBefore if rgb/focus says that the open bracket lacks this frame, else kNow
  };
  void add(const BracketFrame& frame, Time time = Time::kNow);
  /// Time went back: the open bracket ends when the first frame of the new time comes, or after 5 s. The
  /// next bracket begins as the first one after the start did.
  void restart();
  /// Drops all that waits, and the open bracket.
  void abandon();
  /// Ends the open bracket. The future is ready when all frames so far are fused: brackets published since
  /// the start, or -1 after stop().
  std::future<int> finish();
  /// Lets no task come any more.
  void stop();

  /// The next task, or nothing if none came for a while. Ends a bracket after its gap in time.
  std::optional<FusionTask> take();
  /// Whether the result of the current task is of no use any more.
  bool interrupted() const;
  bool stopped() const;

 private:
  void endBracket();
  void endTime();
  std::vector<sensor_msgs::ImageConstPtr> append(FusionTask& task, const FrameInfo& info);
  sensor_msgs::ImageConstPtr dropOldest();

  NodeStatus& status_;
  SceneCache& scenes_;
  mutable std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  BracketAssembler assembler_;
  std::deque<FusionTask> tasks_;
  std::optional<std::chrono::steady_clock::time_point> went_back_;  // until a frame of the new time
  std::size_t most_ = 60, images_ = 0, bytes_ = 0;
  double stamp_age_s_ = 0;  // of the last frame at its arrival: stamps may come from another clock
  bool abandoned_ = false, stopped_ = false;
};

}  // namespace all_in_focus
