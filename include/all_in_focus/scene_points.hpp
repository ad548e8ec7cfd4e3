// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "all_in_focus/camera.hpp"

namespace all_in_focus::core {

/// Computes where the pixels of one row of a picture lie: metres in the camera's frame, X right, Y down, Z
/// forward; NaN where depth is unknown and where no lens can see.
/// depth: CV_16UC1 mm, 0 = unknown; size: of the picture; y: the row; points: size.width of them. Picture,
/// depth and camera show the same; each may have a resolution of its own.
void scenePoints(const cv::Mat& depth, const cv::Size& size, const Camera& camera, int y, cv::Vec3f* points);

}  // namespace all_in_focus::core
