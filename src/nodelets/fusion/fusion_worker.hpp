// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <thread>

#include "frame_queue.hpp"
#include "node_monitor.hpp"
#include "open_bracket.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {

/// Fuses what is in the queue, in a thread of its own, so that callbacks never wait.
class FusionWorker {
 public:
  using Publish = std::function<void(const FusedBracket&)>;  ///< called from the worker's thread

  FusionWorker(NodeMonitor& monitor, FrameQueue& queue, SceneCache& scenes, Publish publish);
  ~FusionWorker();  ///< stops the queue and closes the scene cache

  void configure(const FusionSettings& settings);  ///< from the next bracket on

 private:
  void run();
  void handle(const FusionTask& task);
  void handleFrame(const FusionTask& task);
  void begin(const FusionTask& first);
  void findScene(const ros::Time& first_frame);
  void endBracket(int missing);
  void publish(bool complete);
  void acknowledge(const FrameFates& fates);

  NodeMonitor& monitor_;
  FrameQueue& queue_;
  SceneCache& scenes_;
  const Publish publish_;
  std::mutex mutex_;
  FusionSettings settings_;  // guarded by mutex_

  // Of the worker's thread alone.
  BracketFusion fusion_;
  std::unique_ptr<OpenBracket> bracket_;
  int published_ = 0;

  std::thread thread_;
};

}  // namespace all_in_focus
