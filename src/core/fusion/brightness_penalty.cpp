// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/brightness_penalty.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace all_in_focus::core {
namespace {

constexpr double kNoiseOfMedian = 2;  // gray levels of noise, from which on the median counts alone

}  // namespace

cv::Mat brightnessOf(const cv::Mat& gray, double noise, bool resampled, double clipped) {
  cv::Mat level = gray;
  const double median_share = resampled ? 1 : std::min(1.0, noise / kNoiseOfMedian);
  if (median_share > 0) {
    // OpenCV takes as many columns at once as a vector has bytes, and one by one those that are left. These
    // take twice as long as all others. A width of a multiple of 32 and two more leaves none.
    cv::Mat wide, median;
    cv::copyMakeBorder(gray, wide, 0, 0, 0, (34 - gray.cols % 32) % 32, cv::BORDER_REPLICATE);
    cv::medianBlur(wide, median, 3);
    level = median.colRange(0, gray.cols);
    if (median_share < 1) cv::addWeighted(gray, 1 - median_share, level, median_share, 0, level);
  }
  if (clipped < 255) level = level | (level >= std::floor(clipped));
  return level;
}

}  // namespace all_in_focus::core
