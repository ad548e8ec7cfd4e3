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
  cv::Point anchor;  ///< pixel of the region, well within it
  std::string text;  ///< label and depth range, "3: 0.92-1.05 m"
  cv::Rect box;      ///< of the text in a picture of the labels' size: about the anchor, inside the picture
};

/// How captions are written in a picture: OpenCV's font and its scale, pixels of a line and of the dark rim.
struct CaptionStyle {
  int font = 0;
  double scale = 0;
  int line = 0, rim = 0;
};

CaptionStyle captionStyle(const cv::Size& picture);

/// Captions of the regions that cover at least caption_min_area percent of the picture, largest first. What
/// would cover the caption of a larger region is left out. segmentation.labels: CV_32SC1.
std::vector<RegionCaption> captionRegions(const Segmentation& segmentation, double caption_min_area = 1.0);

}  // namespace all_in_focus::core
