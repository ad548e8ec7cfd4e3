// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/hole_filling.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "util/row_strips.hpp"

namespace all_in_focus::core {
namespace {

constexpr double kStep = 0.25;            // lambda of equation 7
constexpr double kConduction = 25;        // K of equation 6, mm
constexpr std::uint16_t kHoleBelow = 10;  // mm; every smaller depth is a hole
constexpr std::uint16_t kOpen = 0xFFFF;   // width of a hole that reaches the left or right border

void requireDepth(const cv::Mat& depth) {
  if (depth.type() != CV_16UC1 || depth.empty()) {
    throw std::invalid_argument("hole filling: depth must be CV_16UC1 mm and not empty");
  }
}

// C d (equations 5 and 6) for whole mm. From 8 K on it is below 1e-25 mm, and taken for 0.
double flow(int neighbour, int here) {
  constexpr int kReach = static_cast<int>(8 * kConduction);
  static const auto flows = [] {
    std::array<double, 2 * kReach + 1> table{};
    for (int d = -kReach; d <= kReach; ++d)
      table[d + kReach] = std::exp(-(d / kConduction) * (d / kConduction)) * d;
    return table;
  }();
  const auto index = static_cast<unsigned>(neighbour - here + kReach);
  return index < flows.size() ? flows[index] : 0;
}

// First place of a value in from..end-1; end: nowhere.
int find(const std::uint8_t* row, int from, int end, int value) {
  const void* const found = std::memchr(row + from, value, end - from);
  return found ? static_cast<int>(static_cast<const std::uint8_t*>(found) - row) : end;
}

// Fills the holes of a row from the farther of their two ends. width: of the hole that a pixel lies in.
void fillAcross(const std::uint16_t* row, const std::uint8_t* holes, int cols, std::uint16_t* filled,
                std::uint16_t* width) {
  for (int begin = find(holes, 0, cols, 255); begin < cols;) {
    const int end = find(holes, begin, cols, 0);
    const bool closed = begin > 0 && end < cols;
    std::fill(filled + begin, filled + end, closed ? std::max(row[begin - 1], row[end]) : 0);
    std::fill(width + begin, width + end, closed ? end - begin : kOpen);
    begin = find(holes, end, cols, 255);
  }
}

// Fills the holes of some columns at those pixels where they are wider than high.
void fillDown(const cv::Mat1w& depth, const cv::Mat1b& holes, const cv::Range& columns,
              const cv::Mat1w& width, cv::Mat1w& filled) {
  std::vector<int> begin(depth.cols, 0);          // of the last hole; 0: it has no upper end
  std::vector<std::uint8_t> ends(depth.cols, 0);  // 255: a hole begins or ends between this row and the last
  for (int y = 1; y < depth.rows; ++y) {
    const std::uint8_t *const above = holes[y - 1], *const here = holes[y];
    std::transform(above + columns.start, above + columns.end, here + columns.start,
                   ends.begin() + columns.start, std::bit_xor<>());
    for (int x = find(ends.data(), columns.start, columns.end, 255); x < columns.end;
         x = find(ends.data(), x + 1, columns.end, 255)) {
      if (depth(y, x) == 0) {
        begin[x] = y;
        continue;
      }
      for (int v = begin[x]; v > 0 && v < y; ++v) {
        if (y - begin[x] < width(v, x)) filled(v, x) = std::max(depth(begin[x] - 1, x), depth(y, x));
      }
    }
  }
}

}  // namespace

void dilateDepth(const cv::Mat& depth, cv::Mat& dilated) {
  requireDepth(depth);
  cv::dilate(depth, dilated, cv::Mat());
}

void fillByDiffusion(cv::Mat& depth) {
  requireDepth(depth);
  for (int y = 3; y < depth.rows; ++y) {
    auto* const row = depth.ptr<std::uint16_t>(y);
    const auto* const above = depth.ptr<std::uint16_t>(y - 2);  // I(y-2, .) takes the place of I(y, .)
    const auto* const north = depth.ptr<std::uint16_t>(y - 3);
    const auto* const south = depth.ptr<std::uint16_t>(y - 1);
    for (int x = 0; x < depth.cols; ++x) {
      if (row[x] >= kHoleBelow || above[x] < kHoleBelow) continue;
      const int here = above[x];
      const int west = above[std::max(x - 1, 0)], east = above[std::min(x + 1, depth.cols - 1)];
      const double sum = flow(north[x], here) + flow(south[x], here) + flow(west, here) + flow(east, here);
      row[x] = static_cast<std::uint16_t>(here + kStep * sum + 0.5);  // equations 7 and 8
    }
  }
}

void fillFromFarSide(const cv::Mat& depth, cv::Mat& filled) {
  requireDepth(depth);
  depth.copyTo(filled);
  const cv::Mat1w known(depth);
  const cv::Mat1b holes(depth == 0);
  cv::Mat1w width(depth.size()), result(filled);
  inParallel(depth.rows, [&](int y) { fillAcross(known[y], holes[y], depth.cols, result[y], width[y]); });
  RowStrips({0, depth.cols}, stripCount(depth.cols)).forEach([&](const cv::Range& columns, int) {
    fillDown(known, holes, columns, width, result);
  });
}

}  // namespace all_in_focus::core
