// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/brightness_penalty.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace all_in_focus::core {
namespace {

constexpr double kDark = 20;          // gray levels; below, differences in brightness count little
constexpr double kNoiseOfMedian = 2;  // gray levels of noise, from which on the median counts alone

}  // namespace

BrightnessPenalty brightnessPenalty(const cv::Mat& gray, double noise, bool resampled) {
  BrightnessPenalty penalty{gray};
  const double median_share = resampled ? 1 : std::min(1.0, noise / kNoiseOfMedian);
  if (median_share > 0) {
    // OpenCV takes as many columns at once as a vector has bytes, and one by one those that are left. These
    // take twice as long as all others. A width of a multiple of 32 and two more leaves none.
    cv::Mat wide, median;
    cv::copyMakeBorder(gray, wide, 0, 0, 0, (34 - gray.cols % 32) % 32, cv::BORDER_REPLICATE);
    cv::medianBlur(wide, median, 3);
    median = median.colRange(0, gray.cols);
    if (median_share < 1) cv::addWeighted(gray, 1 - median_share, median, median_share, 0, median);
    penalty.level = median;
  }
  for (int level = 0; level < 256; ++level) {
    penalty.of_level[level] = static_cast<float>(std::pow(kDark / (kDark + level), 1.5));
  }
  return penalty;
}

}  // namespace all_in_focus::core
