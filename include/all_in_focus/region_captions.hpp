// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/dof_segmentation.hpp"

namespace all_in_focus::core {

/// The text on a region in a picture for people.
struct RegionCaption {
  int label = 0;        ///< of the region
  int near_mm = 0;      ///< nearest depth of the region, mm
  cv::Point anchor;     ///< pixel inside the region, far from its border
  std::string text;     ///< label and depth range, "3: 0.92-1.05 m"
  std::string written;  ///< what has room on the region in the picture: the text, label and depth, the label,
                        ///< or nothing
  cv::Rect box;         ///< of what is written, pixels: on the region, as near to the anchor as possible
};

/// How captions are written.
struct CaptionStyle {
  int font = 0;      ///< cv::HersheyFonts
  double scale = 0;  ///< of the font
  int line = 0;      ///< thickness of the letters' lines, pixels
  int rim = 0;       ///< width of the dark rim around them, pixels
};

/// The style for a picture of this size: letters of 4 % of its height, but legible.
CaptionStyle captionStyle(const cv::Size& picture);

/// Captions of the regions that cover at least caption_min_area percent (0..100) of the picture, largest
/// first. One that would be written too close to that of a larger region is left out. Throws
/// std::invalid_argument unless segmentation.labels is CV_32SC1.
std::vector<RegionCaption> captionRegions(const Segmentation& segmentation, double caption_min_area = 1.0);

}  // namespace all_in_focus::core
