// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/camera_curve.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <opencv2/imgproc.hpp>

#include "util/median.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {
namespace {

// Large pictures are sampled to about this width. Means of their pixels would not do: they would be means of
// codes, not of light.
constexpr double kWidth = 800;

constexpr int kReduction = 8;
constexpr double kSigma = 20;     // px, of a wide mean
constexpr int kBorder = 5;        // pixels of a wide mean which light from outside the picture may reach
constexpr double kDark = 8;       // codes; keeps ratios of black places small
constexpr double kClearly = 0.9;  // less of a difference than with sRGB, to be believed

// Wide means of light, as codes, without the border; empty for tiny pictures.
cv::Mat1f wideCodes(const cv::Mat& gray, const LightCurve& curve) {
  const double step = std::max(1.0, std::round(gray.cols / kWidth));
  cv::Mat samples, means;
  cv::resize(gray, samples, {}, 1 / step, 1 / step, cv::INTER_NEAREST);
  const cv::Mat light = linearLight(samples, curve);
  cv::resize(light, means, {std::max(1, light.cols / kReduction), std::max(1, light.rows / kReduction)}, 0, 0,
             cv::INTER_AREA);
  cv::GaussianBlur(means, means, {}, kSigma / kReduction, 0, cv::BORDER_REFLECT_101);
  const cv::Rect inner(kBorder, kBorder, means.cols - 2 * kBorder, means.rows - 2 * kBorder);
  if (inner.width <= 0 || inner.height <= 0) return {};
  cv::Mat1f codes = means(inner).clone();
  for (float& value : codes) value = curve.code(value);
  return codes;
}

// Sum over the others: median deviation of their ratio to the reference from its median. Clipped lights,
// occlusions and what moved change some places by much, with any curve.
double difference(const cv::Mat& reference, const std::vector<cv::Mat>& others, const LightCurve& curve) {
  const cv::Mat1f of_reference = wideCodes(reference, curve);
  if (of_reference.empty()) return 0;
  double sum = 0;
  for (const cv::Mat& other : others) {
    const cv::Mat1f ratio(wideCodes(other, curve) / cv::max(of_reference, kDark));
    std::vector<float> values(ratio.begin(), ratio.end());
    const float usual = median(values);
    for (float& value : values) value = std::abs(value - usual);
    sum += median(values);
  }
  return sum;
}

}  // namespace

bool hasLinearCodes(const cv::Mat& reference, const std::vector<cv::Mat>& others) {
  return difference(reference, others, LightCurve::linear()) <
         kClearly * difference(reference, others, LightCurve::srgb());
}

}  // namespace all_in_focus::core
