// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/blur_scale.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace all_in_focus::core {
namespace {

constexpr double kFirst = 0.6, kStep = 0.05;
constexpr int kScales = 21;  // 0.6..1.6
constexpr float kClearPx = 5;
constexpr int kGrid = 3;  // every third row and column is enough
constexpr int kLeastSamples = 200;
constexpr float kMostError = 100;       // squared gray levels
constexpr float kSharpPx = 0.5f;        // radius of the sharpest frame, where the fused picture is sharp
constexpr double kLeastContrast = 0.2;  // between the best and the worst scale, squared gray levels

// Squared error of a channel, gray levels, cut.
float squaredError(const cv::Vec3s& a, const cv::Vec3s& b) {
  int sum = 0;
  for (int c = 0; c < 3; ++c) sum += (a[c] - b[c]) * (a[c] - b[c]);
  return std::min(static_cast<float>(sum) / (3 * kCodeScale * kCodeScale), kMostError);
}

}  // namespace

double measureBlurScale(const ObservedBracket& bracket, const BlurredPictures& pictures) {
  const cv::Mat1f clear = distanceFromDoubt(bracket);
  std::array<double, kScales> errors{};
  int samples = 0, compared = 0;
  for (int y = kGrid / 2; y < clear.rows; y += kGrid) {
    for (int x = kGrid / 2; x < clear.cols; x += kGrid) {
      if (clear(y, x) <= kClearPx) continue;
      std::vector<const ObservedFrame*> frames;
      for (const ObservedFrame& frame : bracket.frames) {
        if (frame.seen.contains({x, y})) frames.push_back(&frame);
      }
      const auto radius = [&](const ObservedFrame* frame) {
        return frame->blur.radius(bracket.measured(y, x));
      };
      if (std::none_of(frames.begin(), frames.end(), [&](const auto* f) { return radius(f) < kSharpPx; }))
        continue;
      ++samples;
      compared += static_cast<int>(frames.size());
      for (const ObservedFrame* frame : frames) {
        for (int i = 0; i < kScales; ++i) {
          const float scaled = static_cast<float>(kFirst + i * kStep) * radius(frame);
          errors[i] += squaredError(pictures.at(scaled)(y, x), frame->codes(y, x));
        }
      }
    }
  }
  const auto [least, most] = std::minmax_element(errors.begin(), errors.end());
  // Without texture every blur looks alike.
  if (samples < kLeastSamples || *most - *least <= kLeastContrast * compared) return 0;
  return kFirst + kStep * lowest(errors.data(), kScales);
}

}  // namespace all_in_focus::core
