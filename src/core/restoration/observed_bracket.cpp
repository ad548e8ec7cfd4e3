// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/observed_bracket.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "util/linear_light.hpp"
#include "util/row_strips.hpp"

namespace all_in_focus::core {
namespace {

constexpr float kLeastRatio = 0.8f, kLargestRatio = 1.25f;
constexpr float kDark = 1e-3f;  // light; keeps ratios of black pixels small

}  // namespace

cv::Mat1b jumps(const cv::Mat1f& inverse_depth, float gap) {
  cv::Mat1b found(inverse_depth.size(), 0);
  for (int y = 0; y < inverse_depth.rows; ++y) {
    for (int x = 0; x < inverse_depth.cols; ++x) {
      const float here = inverse_depth(y, x);
      if (x > 0 && std::abs(here - inverse_depth(y, x - 1)) > gap) found(y, x) = found(y, x - 1) = 255;
      if (y > 0 && std::abs(here - inverse_depth(y - 1, x)) > gap) found(y, x) = found(y - 1, x) = 255;
    }
  }
  return found;
}

cv::Mat1f distanceFromDoubt(const ObservedBracket& bracket) {
  const cv::Mat1b doubt(jumps(bracket.measured, bracket.gap(kJumpPx)) | (bracket.measured == 0));
  cv::Mat1f distance;
  cv::distanceTransform(255 - doubt, distance, cv::DIST_L2, 3);
  return distance;
}

void equalize(const cv::Mat& frame, double gain, const cv::Mat3f& light, const LightCurve& curve,
              cv::Mat3s& codes) {
  cv::Mat3f own = linearLight(frame, curve);
  own *= curve.gainOf(gain);
  cv::Mat3f ratio = wideMean(own), wanted = wideMean(light);
  for (int y = 0; y < ratio.rows; ++y) {
    for (int x = 0; x < ratio.cols; ++x) {
      for (int c = 0; c < 3; ++c) {
        float& r = ratio(y, x)[c];
        r = std::clamp((wanted(y, x)[c] + kDark) / (r + kDark), kLeastRatio, kLargestRatio);
      }
    }
  }
  cv::resize(ratio, ratio, own.size(), 0, 0, cv::INTER_LINEAR);
  codes.create(own.size());
  forEachRow(own.rows, [&](int y) {
    const float* from = own.ptr<float>(y);
    const float* times = ratio.ptr<float>(y);
    short* to = codes.ptr<short>(y);
    for (int i = 0; i < 3 * own.cols; ++i)
      to[i] = static_cast<short>(kCodeScale * curve.code(from[i] * times[i]) + 0.5f);
  });
}

}  // namespace all_in_focus::core
