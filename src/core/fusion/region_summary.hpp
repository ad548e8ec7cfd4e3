// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/fusion.hpp"

namespace all_in_focus::core {

/// What pixel-wise fusion did in each region: the frame that won most of its pixels, score = their share,
/// margin = 1 - share of the runner-up / score, confidence = mean over the region. labels: CV_32SC1;
/// source_index: CV_16UC1; confidence: CV_8UC1, all of one size.
std::vector<RegionChoice> summarizeRegions(const cv::Mat& labels, const cv::Mat& source_index,
                                           const cv::Mat& confidence);

/// A line for every distance at which the scene has a region but no frame is sharp: the smallest blur circle
/// there exceeds twice the circle of confusion. Empty when depth, labels or focus distances are unknown.
/// focus_mm: of the frames used.
std::vector<std::string> unreachedDistances(const BracketScene& scene, const std::vector<double>& focus_mm);

}  // namespace all_in_focus::core
