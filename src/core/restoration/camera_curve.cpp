// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/camera_curve.hpp"

#include <algorithm>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "restoration/observed_bracket.hpp"

namespace all_in_focus::core {
namespace {

constexpr float kDark = 8;        // codes; keeps ratios of black places small
constexpr double kClearly = 0.9;  // less of a difference than with sRGB, to be believed

// Wide means of the light of the green channel, as codes.
cv::Mat1f wideCodes(const cv::Mat& picture, const LightCurve& curve) {
  cv::Mat green;
  cv::extractChannel(picture, green, 1);
  cv::Mat1f table(1, 256), light;
  for (int code = 0; code < 256; ++code) table(code) = curve.light(code);
  cv::LUT(green, table, light);
  cv::Mat1f codes = wideMean(light);
  for (float& value : codes) value = curve.code(value);
  return codes;
}

// Mean absolute deviation of frame / fused from its mean, over pixels whose wide means are of valid ones.
double difference(const cv::Mat1f& fused, const cv::Mat1f& frame, const cv::Rect& valid) {
  if (valid.empty()) return 0;
  cv::Mat1f ratio;
  cv::divide(frame(valid), cv::max(fused(valid), kDark), ratio);
  return cv::norm(ratio, cv::Mat1f(ratio.size(), static_cast<float>(cv::mean(ratio)[0])), cv::NORM_L1) /
         static_cast<double>(ratio.total());
}

// Sum over the frames.
double difference(const cv::Mat& fused, const std::vector<cv::Mat>& frames, const std::vector<cv::Rect>& seen,
                  const LightCurve& curve) {
  const cv::Mat1f of_fused = wideCodes(fused, curve);
  std::vector<double> differences(frames.size());
  cv::parallel_for_({0, static_cast<int>(frames.size())}, [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k)
      differences[k] =
          difference(of_fused, wideCodes(frames[k], curve), validInWideMean(seen[k], fused.size()));
  });
  return std::accumulate(differences.begin(), differences.end(), 0.0);
}

}  // namespace

const LightCurve& cameraCurve(const cv::Mat& fused, const std::vector<cv::Mat>& frames,
                              const std::vector<cv::Rect>& seen) {
  const LightCurve &srgb = LightCurve::srgb(), &proportional = LightCurve::proportional();
  const bool is_proportional =
      difference(fused, frames, seen, proportional) < kClearly * difference(fused, frames, seen, srgb);
  return is_proportional ? proportional : srgb;
}

}  // namespace all_in_focus::core
