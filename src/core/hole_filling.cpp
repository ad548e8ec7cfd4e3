// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/hole_filling.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

namespace all_in_focus::core {
namespace {

void requireDepth(const cv::Mat& depth) {
  if (depth.type() != CV_16UC1 || depth.empty()) {
    throw std::invalid_argument("hole filling: depth must be CV_16UC1 mm and not empty");
  }
}

}  // namespace

void dilateDepth(const cv::Mat& depth, cv::Mat& dilated) {
  requireDepth(depth);
  cv::dilate(depth, dilated, cv::Mat());  // equation 4; an empty element is the 3x3 rectangle
}

void DiffusionFilling::fill(cv::Mat& depth) const {
  requireDepth(depth);
  if (!(conduction_mm > 0)) throw std::invalid_argument("hole filling: the conduction K must be positive");
  // C d (equations 5 and 6) for whole mm; from 8 K on it is below 1e-25 mm.
  const int reach = std::min(65535, static_cast<int>(8 * conduction_mm));
  std::vector<double> flows_by_difference(2 * reach + 1);
  for (int d = -reach; d <= reach; ++d) {
    flows_by_difference[d + reach] = std::exp(-(d / conduction_mm) * (d / conduction_mm)) * d;
  }
  const auto flow = [&](int neighbour, int here) {
    const int d = neighbour - here;
    return d < -reach || d > reach ? 0.0 : flows_by_difference[d + reach];
  };
  for (int i = 3; i < depth.rows; ++i) {
    std::uint16_t* const row = depth.ptr<std::uint16_t>(i);
    const std::uint16_t* const above =
        depth.ptr<std::uint16_t>(i - 2);  // I(i-2, .) takes the place of I(i, .)
    const std::uint16_t* const north = depth.ptr<std::uint16_t>(i - 3);
    const std::uint16_t* const south = depth.ptr<std::uint16_t>(i - 1);
    for (int j = 0; j < depth.cols; ++j) {
      if (row[j] >= hole_below_mm || above[j] < hole_below_mm) continue;
      const int here = above[j];
      double flows = flow(north[j], here) + flow(south[j], here);  // equation 8
      if (j > 0) flows += flow(above[j - 1], here);
      if (j + 1 < depth.cols) flows += flow(above[j + 1], here);
      row[j] = static_cast<std::uint16_t>(here + lambda * flows + 0.5);  // equation 7
    }
  }
}

void FarSideFilling::fill(cv::Mat& depth) const {
  requireDepth(depth);
  for (int i = 0; i < depth.rows; ++i) {
    std::uint16_t* const row = depth.ptr<std::uint16_t>(i);
    int begin = 0;
    while (begin < depth.cols) {
      if (row[begin] != 0) {
        ++begin;
        continue;
      }
      int end = begin;
      while (end < depth.cols && row[end] == 0) ++end;
      const bool open = begin == 0 || end == depth.cols;
      if (!open && (max_width_px == 0 || end - begin <= max_width_px)) {
        std::fill(row + begin, row + end, std::max(row[begin - 1], row[end]));
      }
      begin = end;
    }
  }
}

}  // namespace all_in_focus::core
