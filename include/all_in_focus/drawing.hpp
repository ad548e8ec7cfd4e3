// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/region_captions.hpp"

namespace all_in_focus::core {

/// Colours of the labels 0..count in drawLabels(), BGR: from red (near) to blue (far), 0 black.
std::vector<cv::Vec3b> labelColors(int count);

/// Draws a label image for people, in labelColors(); every other label is darker, so that neighbours differ.
/// labels: CV_32SC1, values 0..count, else std::invalid_argument. picture: CV_8UC3, BGR.
void drawLabels(const cv::Mat& labels, int count, cv::Mat& picture);

/// Writes captions on their regions in a picture of the labels' size, in white with a dark rim. picture:
/// CV_8UC3, else std::invalid_argument.
void drawCaptions(const std::vector<RegionCaption>& captions, cv::Mat& picture);

/// The picture of regions for people: drawLabels(), captions, and below them a legend with metres.
/// segmentation: labels and segments; without a segment the legend is empty. captions: captionRegions().
/// picture: CV_8UC3, BGR, higher than the labels by what follows from their width.
void drawRegions(const Segmentation& segmentation, const std::vector<RegionCaption>& captions,
                 cv::Mat& picture);

/// Draws which frame each pixel was taken from: hue by the frame's index (red first, violet last), brightness
/// by confidence, kNoFrame black. source_index: CV_16UC1. confidence: CV_8UC1 of the same size. frames:
/// length of the bracket. picture: CV_8UC3, BGR. Throws std::invalid_argument on other types or sizes.
void drawWeights(const cv::Mat& source_index, const cv::Mat& confidence, int frames, cv::Mat& picture);

/// Draws what the hues of drawWeights() mean: a patch and the text of each frame, the first on top; of a long
/// bracket some. frames: texts by index. picture: CV_8UC3, BGR.
void drawWeightsLegend(const std::vector<std::string>& frames, cv::Mat& picture);

}  // namespace all_in_focus::core
