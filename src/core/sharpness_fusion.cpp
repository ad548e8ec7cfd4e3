// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/sharpness_fusion.hpp"

#include <algorithm>
#include <cstdint>

#include "all_in_focus/region_fusion.hpp"

namespace all_in_focus::core {

void SharpnessFusion::begin(const cv::Size& size) {
  image_.create(size, CV_8UC3);
  source_index_.create(size, CV_16UC1);
  best_.create(size, CV_32FC1);
  second_.create(size, CV_32FC1);
  image_.setTo(cv::Scalar::all(0));
  source_index_.setTo(kNoFrame);
  best_.setTo(-1);
  second_.setTo(-1);
}

void SharpnessFusion::add(const cv::Mat& frame, const cv::Mat& gray, int index) {
  measure_.compute(gray, sharpness_);
  for (int y = 0; y < frame.rows; ++y) {
    const auto* from = frame.ptr<cv::Vec3b>(y);
    const float* sharpness = sharpness_.ptr<float>(y);
    auto* to = image_.ptr<cv::Vec3b>(y);
    auto* source = source_index_.ptr<std::uint16_t>(y);
    float* best = best_.ptr<float>(y);
    float* second = second_.ptr<float>(y);
    for (int x = 0; x < frame.cols; ++x) {
      if (sharpness[x] > best[x]) {
        second[x] = best[x];
        best[x] = sharpness[x];
        to[x] = from[x];
        source[x] = static_cast<std::uint16_t>(index);
      } else {
        second[x] = std::max(second[x], sharpness[x]);
      }
    }
  }
}

cv::Mat SharpnessFusion::confidence() const {
  cv::Mat confidence(best_.size(), CV_8UC1);
  for (int y = 0; y < best_.rows; ++y) {
    const float* best = best_.ptr<float>(y);
    const float* second = second_.ptr<float>(y);
    auto* out = confidence.ptr<std::uint8_t>(y);
    for (int x = 0; x < best_.cols; ++x) {
      const float margin = second[x] < 0 ? 1.0f : best[x] > 0 ? 1 - second[x] / best[x] : 0.0f;
      out[x] = static_cast<std::uint8_t>(255 * margin + 0.5f);
    }
  }
  return confidence;
}

}  // namespace all_in_focus::core
