// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Topics that one node publishes for another, or that messages for people name. Not resolved.
namespace all_in_focus::topics {

constexpr const char* kImage = "rgb/image";
constexpr const char* kFocus = "rgb/focus";
constexpr const char* kColorInfo = "rgb/camera_info";
constexpr const char* kOptics = "rgb/optics";
constexpr const char* kDepth = "depth_registered/image";         ///< holes filled
constexpr const char* kMeasured = "depth_registered/image_raw";  ///< before its holes were filled
constexpr const char* kDepthInfo = "depth_registered/camera_info";
constexpr const char* kLabels = "segmentation/labels";
constexpr const char* kPoints = "all_in_focus/points";

}  // namespace all_in_focus::topics
