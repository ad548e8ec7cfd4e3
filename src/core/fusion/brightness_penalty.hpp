// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// Of frames that look equally sharp, prefers the darker. Beside an edge blur mixes the light of two
/// surfaces. Gray levels are about the square root of light: the bright surface's light raises those of the
/// dark one by much, while the dark one lowers those of the bright one by little. So the darker value is the
/// safer one.
///
/// The sharpness of a frame is multiplied by (20 / (20 + v))^1.5 (SharpnessPyramid), v its gray level in the
/// exposure of the reference. Noise, and the ringing of resampling, would favour frames that are dark by
/// chance, so there v is a mean of the pixel and of the median of its 3 x 3 neighbours: the median counts by
/// its share min(1, deviation of the noise / 2), and alone where frames of the bracket are resampled. What is
/// clipped may be as bright as white.
///
/// Returns v, CV_8UC1. gray: CV_8UC1, in the exposure of the reference; noise: standard deviation, gray
/// levels; resampled: frames of the bracket are; clipped: the level that the frame shows of white.
cv::Mat brightnessOf(const cv::Mat& gray, double noise, bool resampled, double clipped = 255);

}  // namespace all_in_focus::core
