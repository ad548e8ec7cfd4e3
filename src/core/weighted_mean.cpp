// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/weighted_mean.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core/utility.hpp>
#include <vector>

#include "all_in_focus/region_fusion.hpp"

namespace all_in_focus::core {
namespace {

// Mean modified Laplacian of white noise of deviation 1: two second differences of deviation sqrt(6), each
// with mean absolute value sqrt(2 / pi).
const double kSharpnessOfNoise = 2 * std::sqrt(6) * std::sqrt(2 / CV_PI);

// Rounding to 8 bits is noise as well; below it nothing can be told.
constexpr double kRounding = 1;

// A gain from a frame below this share of the error's own noise is not worth the loss of a frame to average.
constexpr double kNoiseVariances = 4;

}  // namespace

void WeightedMean::begin(const cv::Size& size, double noise, bool soft) {
  soft_ = soft;
  frames_ = 0;
  sharpness_of_noise_ = kSharpnessOfNoise * noise;
  sharpness_floor_ = static_cast<float>(kRounding + sharpness_of_noise_);
  error_floor_ = static_cast<float>(kRounding + kNoiseVariances * noise * noise);
  sum_.create(size, CV_32FC4);
  sum_.setTo(0);
  most_.create(size, CV_32FC1);
  most_.setTo(0);
  source_index_.create(size, CV_16UC1);
  source_index_.setTo(kNoFrame);
}

void WeightedMean::add(const cv::Mat& frame, const std::array<float, 256>& codes, const Evidence& evidence,
                       const cv::Rect& inside, int index) {
  ++frames_;
  const auto trust = static_cast<float>(evidence.trust);
  cv::parallel_for_(cv::Range(inside.y, inside.y + inside.height), [&](const cv::Range& rows) {
    std::vector<float> weights(inside.width);
    for (int y = rows.start; y < rows.end; ++y) {
      float* weight = weights.data();
      const float* sharpness = evidence.sharpness.ptr<float>(y) + inside.x;
      for (int x = 0; x < inside.width; ++x) {
        const float s = sharpness[x] + sharpness_floor_;
        weight[x] = trust * (s * s * s * s * s * s);
      }
      if (!evidence.sharpness_around.empty()) {
        const float* around = evidence.sharpness_around.ptr<float>(y) + inside.x;
        for (int x = 0; x < inside.width; ++x) {
          const float s = around[x] + sharpness_floor_;
          weight[x] *= s * s;
        }
      }
      if (!evidence.squared_error.empty()) {
        const float* error = evidence.squared_error.ptr<float>(y) + inside.x;
        for (int x = 0; x < inside.width; ++x) weight[x] /= error[x] + error_floor_;
      }
      const auto* from = frame.ptr<cv::Vec3b>(y) + inside.x;
      auto* sum = sum_.ptr<cv::Vec4f>(y) + inside.x;
      float* most = most_.ptr<float>(y) + inside.x;
      auto* source = source_index_.ptr<std::uint16_t>(y) + inside.x;
      for (int x = 0; x < inside.width; ++x) {
        const float w = weight[x];
        const bool wins = w > most[x];
        if (soft_) {
          for (int c = 0; c < 3; ++c) sum[x][c] += w * codes[from[x][c]];
        } else if (wins) {
          for (int c = 0; c < 3; ++c) sum[x][c] = codes[from[x][c]];
        }
        sum[x][3] += w;
        if (wins) {
          most[x] = w;
          source[x] = static_cast<std::uint16_t>(index);
        }
      }
    }
  });
}

cv::Mat WeightedMean::image() const {
  cv::Mat image(sum_.size(), CV_8UC3, cv::Scalar::all(0));
  for (int y = 0; y < image.rows; ++y) {
    const auto* sum = sum_.ptr<cv::Vec4f>(y);
    auto* out = image.ptr<cv::Vec3b>(y);
    for (int x = 0; x < image.cols; ++x) {
      if (!(sum[x][3] > 0)) continue;
      const float scale = soft_ ? 1 / sum[x][3] : 1;
      for (int c = 0; c < 3; ++c) out[x][c] = cv::saturate_cast<std::uint8_t>(sum[x][c] * scale);
    }
  }
  return image;
}

cv::Mat WeightedMean::confidence() const {
  cv::Mat confidence(sum_.size(), CV_8UC1);
  const float n = static_cast<float>(frames_);
  for (int y = 0; y < confidence.rows; ++y) {
    const auto* sum = sum_.ptr<cv::Vec4f>(y);
    const float* most = most_.ptr<float>(y);
    auto* out = confidence.ptr<std::uint8_t>(y);
    for (int x = 0; x < confidence.cols; ++x) {
      const float rest = most[x] > 0 ? 1 - sum[x][3] / (n * most[x]) : 0;
      out[x] = frames_ < 2 ? 255 : cv::saturate_cast<std::uint8_t>(255 * rest * n / (n - 1));
    }
  }
  return confidence;
}

}  // namespace all_in_focus::core
