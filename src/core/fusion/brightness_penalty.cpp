// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/brightness_penalty.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr float kDark = 20;           // gray levels; below, differences in brightness count little
constexpr double kNoiseOfMedian = 2;  // gray levels of noise, from which on the median counts alone

// median_share: of the median in the brightness
ALL_IN_FOCUS_SIMD void weighRow(const std::uint8_t* gray, const std::uint8_t* median, float median_share,
                                float contrast, int n, float* sharpness) {
  for (int i = 0; i < n; ++i) {
    const float blend = (1 - median_share) * gray[i] + median_share * median[i];
    const float darkness = kDark / (kDark + std::min(contrast * blend, 255.0f));
    sharpness[i] *= darkness * std::sqrt(darkness);
  }
}

}  // namespace

void BrightnessPenalty::begin(double noise, bool resampled) {
  median_share_ = resampled ? 1 : static_cast<float>(std::min(1.0, noise / kNoiseOfMedian));
}

void BrightnessPenalty::beginFrame(const cv::Mat& gray, double contrast) {
  gray_ = gray;
  contrast_ = static_cast<float>(contrast);
  if (median_share_ > 0) cv::medianBlur(gray, median_, 3);
}

void BrightnessPenalty::weigh(int y, float* sharpness) const {
  const cv::Mat& median = median_share_ > 0 ? median_ : gray_;
  weighRow(gray_.ptr(y), median.ptr(y), median_share_, contrast_, gray_.cols, sharpness);
}

}  // namespace all_in_focus::core
