// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "all_in_focus/camera.hpp"

namespace all_in_focus {

/// Binary PLY of all pixels with known depth: position in the camera's frame, metres (X right, Y down, Z
/// forward), and colour. image: CV_8UC3; depth: CV_16UC1 mm, 0 = unknown; all show the same picture, at any
/// resolution.
std::string pointCloudPly(const cv::Mat& image, const cv::Mat& depth, const core::Camera& camera);

}  // namespace all_in_focus
