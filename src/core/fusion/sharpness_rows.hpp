// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "util/image_rows.hpp"

namespace all_in_focus::core {

/// How sharp a frame is, row by row: the modified Laplacian |I_xx| + |I_yy| (Nayar and Nakagawa 1994) in two
/// Gaussian windows, 0..1020. Quickest when rows are asked for top down.
class SharpnessRows {
 public:
  /// gray: CV_8UC1, not empty, else std::invalid_argument; must outlive the rows.
  void begin(const cv::Mat& gray);

  /// In a window of 1.2 px. Valid until around() or reduced() moves on by a dozen rows.
  const float* small(int y);

  /// In a window of 5 px, computed on a quarter of rows and columns. Valid until the next call.
  const float* around(int y);

  /// The small window scaled down to a quarter of rows and columns.
  cv::Size reducedSize() const { return reduced_size_; }
  void reduced(int y, float* out);

 private:
  void laplacian(int y, float* out) const;

  cv::Mat gray_;
  cv::Size reduced_size_;
  GaussianRows window_;
  LineBuffer small_;
  DownsampledRows reduced_;
  GaussianRows window_around_;
  UpsampledRows around_;
};

}  // namespace all_in_focus::core
