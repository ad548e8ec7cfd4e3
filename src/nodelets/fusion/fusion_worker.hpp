// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <thread>

#include "bracket_restorer.hpp"
#include "frame_queue.hpp"
#include "node_status.hpp"
#include "open_bracket.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {

/// Fuses the brackets in the queue in a thread of its own, so that callbacks never wait. In mode restored a
/// bracket is published when it is restored; if the next one is fused first, it is published as it was fused.
class FusionWorker {
 public:
  /// Called from the worker's thread or from that of restoration, one result after the other.
  using Publish = std::function<void(const FusedBracket&)>;

  FusionWorker(NodeStatus& status, FrameQueue& queue, SceneCache& scenes, Publish publish);
  ~FusionWorker();  ///< stops the queue and closes the scene cache

  void configure(const FusionSettings& settings);  ///< from the next bracket on

 private:
  void run();
  void handle(const FusionTask& task);
  void handleFrame(const FusionTask& task);
  void findScene(const sensor_msgs::Image& first_frame);
  void endBracket(int missing);
  FusedBracket fused(bool complete);
  FusionSettings settings();
  void acknowledge(const FrameFates& fates);

  NodeStatus& status_;
  FrameQueue& queue_;
  SceneCache& scenes_;
  const Publish publish_;
  std::mutex mutex_;
  FusionSettings settings_;  // guarded by mutex_

  // Used by the worker's thread only.
  BracketFusion fusion_;
  std::unique_ptr<OpenBracket> bracket_;
  int published_ = 0;  // includes brackets that are being restored

  BracketRestorer restorer_;
  std::thread thread_;
};

}  // namespace all_in_focus
