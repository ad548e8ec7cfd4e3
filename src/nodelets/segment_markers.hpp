// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <std_msgs/Header.h>
#include <visualization_msgs/MarkerArray.h>

#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/camera.hpp"
#include "all_in_focus/region_captions.hpp"

namespace all_in_focus {

/// Captions of a label image.
struct CaptionSet {
  std_msgs::Header header;  ///< of the label image
  cv::Size size;            ///< of the label image
  int labels = 0;           ///< how many there are, captioned or not: sets the colours
  std::vector<core::RegionCaption> captions;
};

/// The captions as text in space for rviz. Each lies on the ray of its anchor, at the near end of its region,
/// because farther back the points of the region would hide it. camera: of the label image.
visualization_msgs::MarkerArray toMarkers(const CaptionSet& set, const core::Camera& camera);

}  // namespace all_in_focus
