// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <all_in_focus/FocusFrame.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <string>

#include "all_in_focus/pipeline.hpp"
#include "conversions.hpp"

namespace all_in_focus {

/// A colour frame with what rgb/focus said of it, if anything.
struct BracketFrame {
  sensor_msgs::ImageConstPtr image;
  FocusFrameConstPtr focus;
};

/// A label image with the table of its regions.
struct LabelSet {
  sensor_msgs::ImageConstPtr labels;
  SegmentArrayConstPtr segments;
};

/// One all-in-focus image and its story. `result.image` is empty when no frame of the bracket could be used.
struct FusedBracket {
  FusionResult result;
  FusionReportPtr report;
  int frames = 0;                    ///< length of the bracket, as far as known
  sensor_msgs::ImageConstPtr depth;  ///< registered depth that the labels were cut from, may be empty
};

/// The bracket being fused: BracketFusion and the report that grows with it. For one thread.
class OpenBracket {
 public:
  /// set: empty = fuse by sharpness alone. wanted_reference: index of the frame whose stamp the result is to
  /// carry; when it is lost, the nearest one stands in. Returns what is wrong with the labels (then sharpness
  /// decides), or "".
  std::string begin(const std_msgs::Header& first_frame, std::uint32_t bracket_id, Mode mode,
                    int wanted_reference, const LabelSet& set);

  /// Returns what is wrong with the frame, which is then left out, or "".
  std::string add(const sensor_msgs::ImageConstPtr& image, int index);

  /// A line of the report.
  void note(const std::string& text);
  void setLabelWait(double ms) { label_wait_ms_ = ms; }

  const FusionReport& report() const { return report_; }

  /// The result so far. missing: frames that never came.
  FusedBracket fused(int missing);

 private:
  bool nearerToReference(int index) const;

  LabelSet set_;  // the fusion reads the message's own memory
  BracketFusion fusion_;
  FusionReport report_;
  int wanted_reference_ = 0;
  double fusion_ms_ = 0, label_wait_ms_ = 0;
};

}  // namespace all_in_focus
