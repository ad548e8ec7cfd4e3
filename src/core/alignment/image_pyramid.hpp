// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// A gray frame, smoothed and downsampled: all that alignment keeps of it. Level 0 has half its size (or
/// less, at most a megapixel), every next level half of that. Pixel p of the frame is p / reduction(i) of
/// level i.
class ImagePyramid {
 public:
  ImagePyramid() = default;
  explicit ImagePyramid(const cv::Mat& gray);  ///< CV_8UC1

  int levels() const { return static_cast<int>(images_.size()); }
  const cv::Mat& level(int i) const { return images_[i]; }  ///< CV_32FC1
  double reduction(int i) const { return finest_reduction_ * (1 << i); }

  /// Local contrast of the coarsest level: what every defocus leaves of a scene.
  const cv::Mat& contrast() const { return contrast_; }

 private:
  std::vector<cv::Mat> images_;
  cv::Mat contrast_;
  int finest_reduction_ = 2;
};

}  // namespace all_in_focus::core
