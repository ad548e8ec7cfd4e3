// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "all_in_focus/focus_measure.hpp"

namespace all_in_focus::core {

/// Fusion without depth: at every pixel the frame with the greatest modified Laplacian wins. The first of
/// equal frames wins.
class SharpnessFusion {
 public:
  void begin(const cv::Size& size);

  /// frame: CV_8UC3; gray: CV_8UC1 of it.
  void add(const cv::Mat& frame, const cv::Mat& gray, int index);

  const cv::Mat& image() const { return image_; }
  const cv::Mat& sourceIndex() const { return source_index_; }
  cv::Mat confidence() const;  ///< CV_8UC1, 255 (1 - runner-up / best)

 private:
  ModifiedLaplacian measure_;
  cv::Mat image_, source_index_;
  cv::Mat sharpness_, best_, second_;  ///< CV_32FC1; -1 = no frame yet
};

}  // namespace all_in_focus::core
