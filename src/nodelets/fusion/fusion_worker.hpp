// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FocusFrame.h>
#include <sensor_msgs/Image.h>

#include <atomic>
#include <cstddef>
#include <deque>
#include <memory>
#include <mutex>
#include <vector>

#include "all_in_focus/bracket.hpp"
#include "bracket_assembler.hpp"
#include "bracket_scene.hpp"
#include "callback_guard.hpp"
#include "fusion_outputs.hpp"
#include "node_status.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {

struct FusionSettings {
  BracketSettings bracket;  ///< but its length
  BracketConfig ends;       ///< of the open bracket, too
  double label_timeout_s = 2.0;
  bool restore_every = false;  ///< mode restored: the next bracket waits until this one is restored
  CalibrationLens calibration;
  int most_waiting = 60;  ///< images that may wait
};

/// Fuses focus brackets among the slow callbacks of the guard, so that the quick ones never wait. Asks
/// BracketAssembler where brackets begin and end while frames arrive. When too many wait, by number or by
/// bytes, the oldest images are dropped, by whole brackets where possible; their frames stay, so that every
/// bracket that began is reported. All public methods but finish() are thread-safe and return at once.
///
/// Restoration runs among them, too. It stops when a whole further bracket waits, or so many frames that some
/// would soon be dropped.
class FusionWorker {
 public:
  FusionWorker(CallbackGuard& guard, NodeStatus& status, SceneCache& scenes, FusionOutputs& outputs);
  ~FusionWorker();

  /// From the next bracket on.
  void configure(const FusionSettings& settings);

  /// A message of rgb/focus has come; its frame may come much later.
  void announce(const FocusFrame& focus);
  void add(const BracketFrame& frame);
  /// Time went back: ends the open bracket. The next one begins as the first one after the start did.
  void restart();
  /// Nobody wants results any more: drops all that waits, and the open bracket.
  void cancel();
  /// Ends the open bracket, and returns when all frames so far are fused and restored: brackets published
  /// since the start, or -1 if they were cancelled. Call it in a slow callback.
  int finish();

 private:
  /// A frame, or the end of the open bracket: a step that uses no frame.
  struct Task {
    BracketAssembler::Step step;
    sensor_msgs::ImageConstPtr image;  ///< null: it was dropped to make room for newer ones
  };
  struct OpenBracket;

  // Any thread.
  void push(const Task& task);
  std::size_t waitingImages() const;
  void dropWholeBrackets(std::size_t most);
  void drop(Task& task);
  void endBracket();

  // Slow callbacks.
  void handleNext();
  void onTimer();
  void handle(const Task& task);
  void open(const FocusFrame& first);
  void awaitScene(const FocusFrame& first, const sensor_msgs::Image& image);
  void beginBracket();
  FrameStatus fuse(const Task& task);
  void releaseFrames();
  void findWhite(const cv::Mat& bgr);
  cv::Mat inFullRange(const cv::Mat& bgr) const;
  void joinScene();
  std::vector<FrameStatus> finishBracket();
  void publish(const BracketResult& result, bool complete);
  FusionReportPtr toReport(const BracketResult& result) const;
  bool mayRestore(double done) const;

  CallbackGuard& guard_;
  NodeStatus& status_;
  SceneCache& scenes_;
  FusionOutputs& outputs_;

  std::atomic<bool> is_cancelled_{false};  // the next call of handleNext() is to drop the open bracket

  mutable std::mutex mutex_;  // guards all up to the next comment
  FusionSettings settings_;
  BracketAssembler assembler_;
  std::deque<Task> tasks_;      // for each a call of handleNext() is posted
  std::size_t limit_ = 1;       // how many images of the size of the newest may wait
  ros::Time last_frame_;        // when it came, for the gap
  ros::WallTime silent_since_;  // the same, for the warning

  // Used by slow callbacks only.
  Bracket bracket_;
  std::unique_ptr<OpenBracket> open_;
  int published_ = 0;
  ros::WallTimer timer_;
};

}  // namespace all_in_focus
