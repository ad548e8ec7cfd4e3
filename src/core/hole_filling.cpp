// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/hole_filling.hpp"

#include <algorithm>
#include <climits>
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

void FarSideFilling::fill(const cv::Mat& depth, cv::Mat& filled) {
  requireDepth(depth);
  depth.copyTo(filled);
  above_.create(depth.size());
  // Nearest known depth and distance to it, carried from row to row.
  const auto carry = [this](const std::uint16_t* row, int j) {
    cv::Vec2w& nearest = column_[j];
    nearest = row[j] != 0 ? cv::Vec2w(row[j], 0) : cv::Vec2w(nearest[0], nearest[1] + 1);
  };
  column_.assign(depth.cols, {0, 0});
  for (int i = 0; i < depth.rows; ++i) {
    const auto* row = depth.ptr<std::uint16_t>(i);
    for (int j = 0; j < depth.cols; ++j) carry(row, j);
    std::copy(column_.begin(), column_.end(), above_[i]);
  }
  column_.assign(depth.cols, {0, 0});
  for (int i = depth.rows - 1; i >= 0; --i) {
    const auto* row = depth.ptr<std::uint16_t>(i);
    auto* out = filled.ptr<std::uint16_t>(i);
    for (int begin = 0; begin < depth.cols;) {
      if (row[begin] != 0) {
        carry(row, begin++);
        continue;
      }
      int end = begin;
      for (; end < depth.cols && row[end] == 0; ++end) carry(row, end);
      const bool closed = begin > 0 && end < depth.cols;
      const int width = closed ? end - begin : INT_MAX;
      const std::uint16_t across = closed ? std::max(row[begin - 1], row[end]) : 0;
      for (int j = begin; j < end; ++j) {
        const cv::Vec2w &up = above_(i, j), &down = column_[j];
        const int height = up[0] != 0 && down[0] != 0 ? up[1] + down[1] - 1 : INT_MAX;
        out[j] = height < width ? std::max(up[0], down[0]) : across;
      }
      begin = end;
    }
  }
}

}  // namespace all_in_focus::core
