// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/noise_estimation.hpp"

#include <array>
#include <cstdint>
#include <cstdlib>

namespace all_in_focus::core {
namespace {

constexpr double kMaskNorm = 6;             // root of the sum of squares of the mask
constexpr double kMedianOfNormal = 0.6745;  // median of |x|, x normal with deviation 1
constexpr int kRowStep = 2;                 // every other row is plenty for a median

}  // namespace

double noiseDeviation(const cv::Mat& gray) {
  std::array<int, 8 * 255 + 1> histogram{};
  int total = 0;
  for (int v = 1; v + 1 < gray.rows; v += kRowStep) {
    const auto* north = gray.ptr<std::uint8_t>(v - 1);
    const auto* here = gray.ptr<std::uint8_t>(v);
    const auto* south = gray.ptr<std::uint8_t>(v + 1);
    const auto column = [&](int u) { return north[u] - 2 * here[u] + south[u]; };
    for (int u = 1; u + 1 < gray.cols; ++u, ++total) {
      ++histogram[std::abs(column(u - 1) - 2 * column(u) + column(u + 1))];
    }
  }
  if (total == 0) return 0;
  // The median within its bin of integer responses: the bin m holds responses from m - 0.5 to m + 0.5.
  int below = 0, median = 0;
  while (2 * (below + histogram[median]) < total) below += histogram[median++];
  const double share = (total / 2.0 - below) / histogram[median];
  const double response = median == 0 ? 0.5 * share : median - 0.5 + share;
  return response / (kMedianOfNormal * kMaskNorm);
}

}  // namespace all_in_focus::core
