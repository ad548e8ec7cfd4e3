// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "bracket_assembler.hpp"
#include "node_monitor.hpp"
#include "open_bracket.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {

struct FusionSettings {
  Mode mode = Mode::kRefined;
  int reference = -1;  ///< index, or -1: the middle one where the length is known in advance, else the first
  bool sliding = false;
  BracketConfig bracket;
  int max_held_frames = 64;
  double label_max_age_s = 1.0;
  double label_timeout_s = 2.0;
  int max_queued_frames = 60;
};

/// Fuses brackets in a thread of its own, so that callbacks never wait. Frames queue up while a label image
/// is awaited or a frame is being fused; when the queue is full the oldest is dropped. All methods are
/// thread-safe and return at once, but finish().
class FusionWorker {
 public:
  using Publish = std::function<void(const FusedBracket&)>;  ///< called from the worker's thread

  FusionWorker(NodeMonitor& monitor, SceneCache& scenes, Publish publish);
  ~FusionWorker();  ///< closes the scene cache

  void configure(const FusionSettings& settings);  ///< bracket: at once; the rest with the next bracket
  void addFrame(const BracketFrame& frame);

  /// Time went back: ends the open bracket, the next one is the first.
  void restart();

  /// Nobody listens any more: drops the open bracket and all that waits.
  void stopListening();

  /// Ends the open bracket when all frames so far are fused. Waits for that; returns the number of brackets
  /// published since the start, or -1 when it took too long.
  int finish();

 private:
  struct Job {
    BracketFrame frame;  // or, without an image:
    bool restart = false;
    std::shared_ptr<std::promise<int>> finished;
  };

  void add(const Job& job);
  void run();
  void handle(const Job& job);
  void handleFrame(const BracketFrame& frame);
  void begin(const BracketFrame& frame, int index);
  int plannedReference(const BracketFrame& first, int first_index, std::string& remark) const;
  void fuse(const BracketFrame& frame, const BracketAssembler::Step& step);
  bool fuseWaiting(int arrived, std::string& trouble);
  void tell(const sensor_msgs::Image& frame, const std::string& trouble);
  void closeBracket();
  void giveUp();
  void publish(bool complete);
  bool interrupted();

  NodeMonitor& monitor_;
  SceneCache& scenes_;
  const Publish publish_;

  std::mutex mutex_;  // guards the part up to the next blank line
  std::condition_variable wake_;
  std::deque<Job> jobs_;
  int queued_frames_ = 0;
  bool dropping_ = false;  // stopListening() was called: leave the open bracket
  bool stop_ = false;
  FusionSettings next_settings_;

  // Of the worker's thread alone: the open bracket.
  FusionSettings settings_;
  BracketAssembler assembler_;
  OpenBracket bracket_;
  sensor_msgs::ImageConstPtr depth_;  // that its labels were cut from
  ros::Time depth_stamp_;
  int published_ = 0;
  double stamp_age_s_ = 0;  // of its last frame when that was fused: stamps may be of another clock

  std::thread thread_;
};

}  // namespace all_in_focus
