// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FusionReport.h>
#include <cv_bridge/cv_bridge.h>

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "all_in_focus/bracket_fusion.hpp"
#include "all_in_focus/frame_order.hpp"
#include "all_in_focus/restoration.hpp"
#include "conversions.hpp"
#include "frame_queue.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {

struct FusionSettings {
  Mode mode = Mode::kRefined;
  int reference = -1;  ///< index, or -1: the middle one where the length is known in advance, else the first
  bool sliding = false;
  int max_held_frames = 64;
  double label_max_age_s = 1.0;
  double label_timeout_s = 2.0;
  bool restore_every = false;  ///< mode restored: the next bracket waits until this one is restored
};

/// The scene of the messages in the types of the core.
struct SharedScene {
  BracketScene scene;
  std::vector<std::string> warnings;  ///< what is missing or refused, and its effect, one line each

  // The scene reads the messages' own memory.
  cv_bridge::CvImageConstPtr labels;
  DepthImage depth, measured;
};

/// The scene for a mode: mode paper uses the labels only, and nothing is used without labels. Depth or camera
/// are left out if they are missing or broken. Throws on broken labels.
SharedScene toScene(const SceneMessages& messages, Mode mode);

/// One all-in-focus image and the report on it. `result.image` is empty when no frame of the bracket could be
/// used.
struct FusedBracket {
  FusionResult result;
  FusionReportPtr report;
  std::vector<std::string> warnings;       ///< notes of the report that say what was lost
  int frames = 0;                          ///< length of the bracket, as far as known
  sensor_msgs::ImageConstPtr depth;        ///< registered depth that the labels were cut from, may be empty
  sensor_msgs::CameraInfoConstPtr camera;  ///< may be empty

  /// Mode restored: what the picture, which is that of mode refined yet, can be corrected by. Null: it stays.
  std::shared_ptr<const BracketRestoration> restoration;
  cv::Mat restored_depth;  ///< CV_16UC1 mm, empty: not restored
  void setRestored(const RestorationResult& restored, double took_ms);
};

/// What happened to a frame.
struct FrameFate {
  enum class Kind { kHeld, kUsed, kRejected };
  std_msgs::Header header;
  Kind kind;
  std::string reason;  ///< kRejected: why; else ""
};
using FrameFates = std::vector<FrameFate>;

/// The bracket being fused: its scene, its frames in the order of FrameOrder, and the report that grows with
/// it. For one thread.
class OpenBracket {
 public:
  using Interrupted = std::function<bool()>;  ///< true: nobody wants the result any more

  /// first: the first task of the bracket. fusion: starts anew for this bracket and reuses its buffers.
  OpenBracket(const FusionTask& first, const FusionSettings& settings, BracketFusion& fusion);
  ~OpenBracket();
  OpenBracket(const OpenBracket&) = delete;
  OpenBracket& operator=(const OpenBracket&) = delete;

  const FusionSettings& settings() const { return settings_; }

  bool hasScene() const { return has_scene_; }
  /// Call once, before the first frame. waited_ms: how long the scene took to come. Returns warnings, one
  /// line each, about what is missing. Without usable labels sharpness decides.
  std::vector<std::string> setScene(const SceneMessages& messages, double waited_ms);

  /// Takes the next frame; a frame without an image was dropped. Fuses all frames that can be fused now.
  FrameFates add(const FusionTask& task, const Interrupted& interrupted);
  /// Call when no frame follows: fuses the frames that waited for the reference. missing: how many frames of
  /// the bracket never came.
  FrameFates close(int missing, const Interrupted& interrupted);

  /// The result so far. complete: no frame follows.
  FusedBracket fused(bool complete) const;
  /// Stamp of the depth image that belongs to the result.
  ros::Time depthStamp() const { return depth_stamp_; }

 private:
  struct Frame {
    sensor_msgs::ImageConstPtr image;
    double focus_mm;
  };

  struct Restoration;

  int plannedReference(const FusionTask& first);
  void begin(const BracketScene& scene);
  double focusOf(const BracketFrame& frame, int index);
  FrameFates fuseReady(const Interrupted& interrupted);
  std::string fuse(int index, const Frame& frame);
  void used(int index, const Frame& frame);
  std::string reject(int index, const std::string& reason);
  void note(const std::string& text);

  const FusionSettings settings_;
  BracketFusion& fusion_;
  FusionReport report_;
  bool has_scene_ = false;
  SharedScene scene_;
  std::shared_ptr<Restoration> restoration_;  // mode restored
  sensor_msgs::ImageConstPtr depth_;
  ros::Time depth_stamp_;
  int reference_;  // wanted
  FrameOrder order_;
  std::map<int, Frame> waiting_;  // by index
  int length_ = 0, dropped_ = 0, missing_ = 0;
  bool focus_known_ = false, focus_refused_ = false;
  double fusion_ms_ = 0, scene_wait_ms_ = 0;
};

}  // namespace all_in_focus
