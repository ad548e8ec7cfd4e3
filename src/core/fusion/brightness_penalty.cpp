// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/brightness_penalty.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

namespace all_in_focus::core {
namespace {

constexpr double kDark = 20;          // gray levels; below, differences in brightness count little
constexpr double kExponent = 1.5;     // of the sharpness over all scales
constexpr double kNoiseOfMedian = 2;  // gray levels of noise, from which on the median counts alone

}  // namespace

void BrightnessPenalty::begin(double noise, bool resampled) {
  median_share_ = resampled ? 1 : std::min(1.0, noise / kNoiseOfMedian);
}

void BrightnessPenalty::beginFrame(const cv::Mat& gray, const std::array<float, 256>& lut) {
  for (int code = 0; code < 256; ++code) {
    const double v = std::clamp(lut[code], 0.0f, 255.0f);
    penalty_[code] = static_cast<float>(std::pow(kDark / (kDark + v), kExponent));
  }
  brightness_ = gray;
  if (median_share_ == 0) return;
  cv::medianBlur(gray, median_, 3);
  if (median_share_ < 1) cv::addWeighted(gray, 1 - median_share_, median_, median_share_, 0, median_);
  brightness_ = median_;
}

void BrightnessPenalty::weigh(int y, float* sharpness) const {
  const auto* brightness = brightness_.ptr<std::uint8_t>(y);
  for (int x = 0; x < brightness_.cols; ++x) sharpness[x] *= penalty_[brightness[x]];
}

}  // namespace all_in_focus::core
