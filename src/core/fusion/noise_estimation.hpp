// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// Standard deviation, in gray levels, of the white noise of an image: the median response to the mask that
/// is blind to planes and edges (Immerkaer, Fast Noise Variance Estimation, 1996), which texture, unlike the
/// mean, does not lift as long as half of the image is smooth. gray: CV_8UC1; 0 below 3 x 3 pixels.
double noiseDeviation(const cv::Mat& gray);

}  // namespace all_in_focus::core
