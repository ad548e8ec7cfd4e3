// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/region_captions.hpp"

namespace all_in_focus::core {

/// Colours of the labels 0..count in drawLabels(), BGR.
std::vector<cv::Vec3b> labelColors(int count);

/// Label image for people: hue from near (red) to far (blue) by label rank, neighbours told apart by
/// brightness, 0 black. labels: CV_32SC1, values 0..count; picture: CV_8UC3, BGR.
void drawLabels(const cv::Mat& labels, int count, cv::Mat& picture);

/// Writes captions into a picture of their labels' size, white on a dark rim. picture: CV_8UC3.
void drawCaptions(const std::vector<RegionCaption>& captions, cv::Mat& picture);

/// Which frame won where: hue by frame index (red first, violet last), brightness by confidence, kNoFrame
/// black. source_index: CV_16UC1; confidence: CV_8UC1; frames: length of the bracket; picture: CV_8UC3, BGR.
void drawWeights(const cv::Mat& source_index, const cv::Mat& confidence, int frames, cv::Mat& picture);

}  // namespace all_in_focus::core
