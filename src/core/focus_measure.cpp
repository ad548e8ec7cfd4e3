// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/focus_measure.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace all_in_focus::core {

double normalizedVariance(const GraySums& sums) {
  if (sums.n == 0 || sums.sum == 0) return 0;
  // n mu = S. With S = q n + r, sum (I - mu)^2 = sum (I - q)^2 - r^2 / n: exact integers, so that a flat
  // region gives 0.
  const std::uint64_t q = sums.sum / sums.n, r = sums.sum % sums.n;
  const double about_q = static_cast<double>(sums.sum_of_squares + q * q * sums.n - 2 * q * sums.sum);
  const double remainder = static_cast<double>(r);
  return (about_q - remainder * remainder / static_cast<double>(sums.n)) / static_cast<double>(sums.sum);
}

void ModifiedLaplacian::compute(const cv::Mat& gray, cv::Mat& sharpness) {
  if (gray.type() != CV_8UC1 || gray.empty()) {
    throw std::invalid_argument("focus measure: the image must be CV_8UC1 and not empty");
  }
  raw_.create(gray.size(), CV_32FC1);
  for (int v = 0; v < gray.rows; ++v) {
    const auto* here = gray.ptr<std::uint8_t>(v);
    const auto* north = gray.ptr<std::uint8_t>(v > 0 ? v - 1 : v);  // borders are repeated
    const auto* south = gray.ptr<std::uint8_t>(v + 1 < gray.rows ? v + 1 : v);
    float* out = raw_.ptr<float>(v);
    const auto at = [&](int u, int west, int east) {
      return static_cast<float>(std::abs(2 * here[u] - here[west] - here[east]) +
                                std::abs(2 * here[u] - north[u] - south[u]));
    };
    const int last = gray.cols - 1;
    out[0] = at(0, 0, std::min(1, last));
    for (int u = 1; u < last; ++u) out[u] = at(u, u - 1, u + 1);
    if (last > 0) out[last] = at(last, last - 1, last);
  }
  cv::GaussianBlur(raw_, sharpness, cv::Size(), window_sigma_px_);
}

}  // namespace all_in_focus::core
