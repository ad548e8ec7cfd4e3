// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// Sums over the gray pixels of one region in one frame.
struct GraySums {
  std::uint64_t n = 0;
  std::uint64_t sum = 0;
  std::uint64_t sum_of_squares = 0;
};

/// Focus measure of a region: NV = 1 / (n mu) * sum (I - mu)^2, mu the mean gray value. 0 for an empty or
/// black one.
double normalizedVariance(const GraySums& sums);

/// Focus measure of a pixel: modified Laplacian |I_xx| + |I_yy| (Nayar and Nakagawa 1994) in a Gaussian
/// window. gray: CV_8UC1; sharpness: CV_32FC1, same size.
class ModifiedLaplacian {
 public:
  explicit ModifiedLaplacian(double window_sigma_px = 2.0) : window_sigma_px_(window_sigma_px) {}
  void compute(const cv::Mat& gray, cv::Mat& sharpness);

 private:
  double window_sigma_px_;
  cv::Mat raw_;
};

}  // namespace all_in_focus::core
