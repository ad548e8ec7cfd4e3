// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/region_fusion.hpp"
#include "all_in_focus/sharpness_fusion.hpp"

namespace all_in_focus::core {

struct FusionResult {
  cv::Mat image;         ///< CV_8UC3
  cv::Mat source_index;  ///< CV_16UC1, index of the frame that a pixel was taken from, kNoFrame = none
  cv::Mat confidence;    ///< CV_8UC1, margin of the choice, 0..255
  std::vector<RegionChoice> regions;  ///< by label; empty when fused by sharpness alone
};

/// All-in-focus image of one bracket, frame by frame. Memory does not grow with the number of frames: of each
/// frame only what won is kept. Not thread-safe; buffers are reused from bracket to bracket.
///
/// With labels one frame wins a region (RegionFusion, mode paper); without, one frame wins a pixel
/// (SharpnessFusion).
class BracketFusion {
 public:
  /// Starts a bracket. labels: CV_32SC1, >= 0, any size (scaled to the frames by nearest neighbour), shared,
  /// not copied; empty: no depth, fuse by sharpness alone. Throws std::invalid_argument on another type or a
  /// negative label.
  void begin(const cv::Mat& labels);

  /// frame: CV_8UC3, not empty, of the size of the bracket's first (else std::invalid_argument, and the
  /// bracket is as before). index: 0..65534, names the frame in the result.
  void add(const cv::Mat& frame, int index);

  /// Frames added since begin().
  int frames() const { return frames_; }

  /// The result of the frames so far; images are copies. Throws std::logic_error before the first frame.
  FusionResult result() const;

 private:
  cv::Mat labels_;
  cv::Size size_;
  int frames_ = 0;
  bool by_region_ = false;
  RegionFusion regions_;
  SharpnessFusion sharpness_;
  cv::Mat gray_;
};

}  // namespace all_in_focus::core
