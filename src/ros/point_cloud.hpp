// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>

#include <opencv2/core.hpp>

#include "all_in_focus/camera.hpp"

namespace all_in_focus {

/// A coloured cloud with the fields of depth_image_proc: x, y, z in m, rgb; a point for each pixel, row by
/// row, NaN where depth is unknown. bgr: CV_8UC3; mm: CV_16UC1 of the same size, 0 = unknown; camera: of
/// pictures of the same shape, in any resolution.
sensor_msgs::PointCloud2Ptr toPointCloud(const std_msgs::Header& header, const cv::Mat& bgr,
                                         const cv::Mat& mm, const core::Camera& camera);

}  // namespace all_in_focus
