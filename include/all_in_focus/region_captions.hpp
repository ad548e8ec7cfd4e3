// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/dof_segmentation.hpp"

namespace all_in_focus::core {

/// What is written on a region for people.
struct RegionCaption {
  int label = 0;
  int area = 0;      ///< of the region, pixels
  int near_mm = 0;   ///< nearest depth
  cv::Point anchor;  ///< pixel of the region, well within it: middle of the text
  std::string text;  ///< label and depth range, "3: 0.92-1.05 m"
};

/// Captions of the regions that cover at least caption_min_area percent of the picture, largest first.
/// segmentation.labels: CV_32SC1.
std::vector<RegionCaption> captionRegions(const Segmentation& segmentation, double caption_min_area = 1.0);

}  // namespace all_in_focus::core
