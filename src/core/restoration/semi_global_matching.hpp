// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// Cost of every level (last index) of every pixel.
struct CostVolume {
  CostVolume(const cv::Size& picture, int level_count)
      : size(picture), levels(level_count), costs(picture.height, picture.width * level_count) {}

  std::int16_t* at(int y, int x) { return costs.ptr<std::int16_t>(y) + static_cast<size_t>(x) * levels; }
  const std::int16_t* at(int y, int x) const {
    return costs.ptr<std::int16_t>(y) + static_cast<size_t>(x) * levels;
  }

  cv::Size size;
  int levels;
  cv::Mat1s costs;
};

/// Semi-global matching (Hirschmueller, Stereo processing by semi-global matching and mutual information,
/// 2008): sum over eight paths of the least cost of a way that ends at a pixel and level, where a step to the
/// next level costs `small_step` and a jump up to `jump`, less across colour edges. Costs plus jump may not
/// exceed 32767 / 8.
CostVolume aggregateAlongPaths(const CostVolume& costs, const cv::Mat3b& picture, int small_step, int jump);

}  // namespace all_in_focus::core
