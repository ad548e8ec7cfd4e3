// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FocusFrame.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "bracket_scene.hpp"

namespace all_in_focus {

/// A colour frame with what rgb/focus said of it, if anything.
struct BracketFrame {
  sensor_msgs::ImageConstPtr image;
  FocusFrameConstPtr focus;
};

/// One all-in-focus image and its story. `result.image` is empty when no frame of the bracket could be used.
struct FusedBracket {
  FusionResult result;
  FusionReportPtr report;
  int frames = 0;                          ///< length of the bracket, as far as known
  sensor_msgs::ImageConstPtr depth;        ///< registered depth that the labels were cut from, may be empty
  sensor_msgs::CameraInfoConstPtr camera;  ///< may be empty
};

/// What became of a frame.
struct FusedFrame {
  int index = 0;
  sensor_msgs::ImageConstPtr image;
  std::string trouble;  ///< why it was left out, or ""
};

/// The bracket being fused: BracketFusion, the frames that wait for their reference, and the report that
/// grows with it. For one thread.
///
/// Mode refined fuses the reference first, then what came before it: until it is there, frames are observed
/// and held. Files are fused in the same order (see Pipeline), so both give the same pixels.
class OpenBracket {
 public:
  /// reference: index of the frame whose stamp the result is to carry, and in mode refined geometry and
  /// exposure; when it is lost, the nearest one stands in. Returns lines to warn of: what is missing of the
  /// scene; without usable labels sharpness decides.
  std::vector<std::string> begin(const std_msgs::Header& first_frame, std::uint32_t bracket_id, Mode mode,
                                 int reference, const SceneMessages& messages);

  /// The next frame; last: of the bracket. Returns why it is refused at once, or "".
  std::string arrived(const BracketFrame& frame, int index, bool last);
  /// Frames wait for the reference.
  bool holding() const { return holding_; }
  /// The reference will not come any more.
  void stopHolding() { holding_ = false; }
  /// Fuses one of the frames whose turn it is; false: there is none.
  bool fuseNext(FusedFrame& fused);
  /// Lets go of the frames that wait.
  void forgetFrames() { waiting_.clear(); }

  /// A line of the report.
  void note(const std::string& text);
  void setLabelWait(double ms) { label_wait_ms_ = ms; }

  /// The result so far. missing: frames that never came.
  FusedBracket fused(int missing);

 private:
  struct Frame {
    int index;
    sensor_msgs::ImageConstPtr image;
    double focus_mm;
  };

  double focusOf(const BracketFrame& frame, int index);
  std::string reject(int index, const std::string& reason);
  void used(const Frame& frame);
  bool nearerToReference(int index, int than) const;

  Mode mode_ = Mode::kRefined;
  int wanted_reference_ = 0;
  SharedScene scene_;
  BracketFusion fusion_;
  std::deque<Frame> waiting_;  // by index
  bool holding_ = false;
  FusionReport report_;
  bool focus_known_ = false, focus_refused_ = false;
  double fusion_ms_ = 0, label_wait_ms_ = 0;
};

}  // namespace all_in_focus
