// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/camera.hpp"
#include "all_in_focus/optics.hpp"

namespace all_in_focus {

using namespace core;

/// The warnings of the checks in rig_checks.hpp for a rig and a depth image, one line each; empty: no
/// warning.
struct RigWarnings {
  std::string unit, circle_of_confusion, depth_center, color_center, pose, overlap, mirroring;
  bool apart = false;  ///< no depth falls into the picture, as `overlap` says: nothing can be registered
  cv::Mat registered;  ///< CV_16UC1 mm, depth seen from the colour camera

  /// The warnings that are not empty.
  std::vector<std::string> lines() const;
};

/// Runs the checks. depth: of the depth camera, CV_16UC1 mm, 0 = unknown. optics: nullptr = unknown. picture:
/// gives one of the colour camera, CV_8UC3; empty: none.
RigWarnings checkRig(const Rig& rig, const Optics* optics, const cv::Mat& depth,
                     const std::function<cv::Mat()>& picture);

}  // namespace all_in_focus
