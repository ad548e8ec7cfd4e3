// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/blur_scale.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "util/row_strips.hpp"

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
constexpr int kStripRows = 16;

// Squared error of a channel, gray levels, cut.
float squaredError(const cv::Vec3s& a, const cv::Vec3s& b) {
  int sum = 0;
  for (int c = 0; c < 3; ++c) sum += (a[c] - b[c]) * (a[c] - b[c]);
  return std::min(static_cast<float>(sum) / (3 * kCodeScale * kCodeScale), kMostError);
}

}  // namespace

double measureBlurScale(const ObservedBracket& bracket, const BlurredPictures& pictures) {
  struct Sums {
    std::array<double, kScales> errors{};
    int compared = 0, samples = 0;
  };
  const cv::Mat1f clear = distanceFromDoubt(bracket);
  // The number of strips is fixed, so that the sums do not depend on the number of threads.
  const RowStrips strips({0, (clear.rows + 1) / kGrid}, std::max(1, clear.rows / kStripRows));
  std::vector<Sums> of_strips(strips.count());
  strips.forEach([&](const cv::Range& rows, int strip) {
    Sums& sums = of_strips[strip];
    for (int row = rows.start; row < rows.end; ++row) {
      const int y = kGrid * row + kGrid / 2;
      for (int x = kGrid / 2; x < clear.cols; x += kGrid) {
        if (clear(y, x) <= kClearPx) continue;
        const bool is_sharp =
            std::any_of(bracket.frames.begin(), bracket.frames.end(), [&](const ObservedFrame& frame) {
              return frame.seen.contains({x, y}) && frame.blur.radius(bracket.measured(y, x)) < kSharpPx;
            });
        if (!is_sharp) continue;
        ++sums.samples;
        for (const ObservedFrame& frame : bracket.frames) {
          if (!frame.seen.contains({x, y})) continue;
          const float radius = frame.blur.radius(bracket.measured(y, x));
          const cv::Vec3s& seen = frame.codes(y, x);
          for (int i = 0; i < kScales; ++i) {
            const float scaled = static_cast<float>(kFirst + i * kStep) * radius;
            sums.errors[i] += squaredError(pictures.at(scaled)(y, x), seen);
          }
          ++sums.compared;
        }
      }
    }
  });
  Sums all;
  for (const Sums& sums : of_strips) {
    for (int i = 0; i < kScales; ++i) all.errors[i] += sums.errors[i];
    all.compared += sums.compared;
    all.samples += sums.samples;
  }
  const auto [least, most] = std::minmax_element(all.errors.begin(), all.errors.end());
  // Without texture every blur looks alike.
  if (all.samples >= kLeastSamples && *most - *least > kLeastContrast * all.compared)
    return kFirst + kStep * lowest(all.errors.data(), kScales);
  return 0;
}

}  // namespace all_in_focus::core
