// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/bracket_depth.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "restoration/semi_global_matching.hpp"
#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr struct DepthParameters {
  int most_levels = 48;
  double level = 0.22;  // px of blur, between levels
  // Of a level in a frame: the squared difference of their codes over its variance, gray levels squared.
  float most_cost = 12;       // larger costs are cut, as a frame may show what no other does
  double variance = 1;        // of the fused picture
  double model_error = 0.36;  // and of the lens model, by squared radius
  // All costs of a pixel count where its variance over the frames is so many times that of noise and
  // rounding (gray levels squared).
  double textured = 6, rounding = 0.2;
  // The cost of all levels but the farthest where nothing tells the depth.
  float nearer = 0.05f;
  // Of neighbours: one level apart, and more.
  double small_step = 1.5, jump = 6;
  // Measured depth: the greatest cost of a level beside it, and the px of blur where it begins and is
  // reached.
  float measured_weight = 1.5f, agree = 0.25f, differ = 0.75f;
  float take = 0.45f;  // px of blur; measured depth that differs by less replaces the estimate
  float clear = 6;     // px from a hole or jump; measured depth replaces every estimate there
  int border = 3;      // px of the estimate that light from outside the picture spoils
} kDepth{};

constexpr double kCostScale = 24;  // of costs as integers

// Levels of inverse depth.
struct Levels {
  float least = 0, step = 1;
  int count = 1;

  float inverseDepth(double level) const { return least + static_cast<float>(level) * step; }
  int nearest(float inverse_depth) const {
    return std::clamp(static_cast<int>((inverse_depth - least) / step + 0.5f), 0, count - 1);
  }
};

Levels makeLevels(const ObservedBracket& bracket, const InverseDepthRange& range) {
  const float span = range.largest - range.least, gap = bracket.gap(kDepth.level);
  const int count = std::clamp(static_cast<int>(std::ceil(span / gap)) + 1, 2, kDepth.most_levels);
  return {range.least, std::max(span / static_cast<float>(count - 1), gap), count};
}

// costs[x] += least of the most and the squared difference of two rows of codes times a factor, where shown.
ALL_IN_FOCUS_SIMD void addCosts(const short* a, const short* b, const std::uint8_t* shown, float factor,
                                float most, int n, float* costs) {
  for (int x = 0; x < n; ++x) {
    const int d0 = a[3 * x] - b[3 * x], d1 = a[3 * x + 1] - b[3 * x + 1], d2 = a[3 * x + 2] - b[3 * x + 2];
    const float cost = std::min(most, static_cast<float>(d0 * d0 + d1 * d1 + d2 * d2) * factor);
    costs[x] += shown[x] != 0 ? cost : 0;
  }
}

// The cost of a level by its distance, in levels, from that which was measured.
std::vector<float> costsBesideMeasured(const Levels& levels, double px_mm) {
  std::vector<float> costs(levels.count);
  const float px = levels.step * static_cast<float>(px_mm);
  for (int i = 0; i < levels.count; ++i)
    costs[i] =
        kDepth.measured_weight *
        std::clamp((static_cast<float>(i) * px - kDepth.agree) / (kDepth.differ - kDepth.agree), 0.0f, 1.0f);
  return costs;
}

// How much of depth a pixel tells, 0..1: bare surfaces look alike in all frames, whatever their depth.
cv::Mat1f textureOf(const ObservedBracket& bracket) {
  cv::Mat1f texture(bracket.fused.size(), 0);
  inParallel(texture.rows, [&](int y) {
    for (int x = 0; x < texture.cols; ++x) {
      std::array<float, 3> sum = {};
      float squares = 0, count = 0;
      for (const ObservedFrame& frame : bracket.frames) {
        if (!frame.shown(y, x)) continue;
        for (int c = 0; c < 3; ++c) {
          const float code = static_cast<float>(frame.codes(y, x)[c]) / kCodeScale;
          sum[c] += code;
          squares += code * code;
        }
        ++count;
      }
      if (count < 2) continue;
      for (const float of_channel : sum) squares -= of_channel * of_channel / count;
      texture(y, x) = squares / (3 * (count - 1));
    }
  });
  cv::blur(texture, texture, {3, 3});
  return cv::Mat1f(cv::min(1, texture / (kDepth.textured * (bracket.noise_variance + kDepth.rounding))));
}

// The fused picture has the blur of the sharpest frame already. Radii of the discs that give it the blur of
// each frame at an inverse depth.
std::vector<float> radiiBeyondSharpest(const ObservedBracket& bracket, float inverse_depth) {
  const DiscKernels& discs = DiscKernels::get();
  std::vector<double> variances;
  variances.reserve(bracket.frames.size());
  for (const ObservedFrame& frame : bracket.frames)
    variances.push_back(discs.variance(frame.blur.radius(inverse_depth)));
  const double least = *std::min_element(variances.begin(), variances.end());
  std::vector<float> radii(variances.size());
  std::transform(variances.begin(), variances.end(), radii.begin(),
                 [&](double variance) { return discs.radius(variance - least); });
  return radii;
}

CostVolume costsOf(const ObservedBracket& bracket, const BlurredPictures& pictures, const Levels& levels) {
  const cv::Size size = bracket.fused.size();
  const std::vector<float> beside_measured = costsBesideMeasured(levels, bracket.pxMm());
  const cv::Mat1f texture = textureOf(bracket);
  std::vector<std::vector<float>> beyond_sharpest;
  beyond_sharpest.reserve(levels.count);
  for (int l = 0; l < levels.count; ++l)
    beyond_sharpest.push_back(radiiBeyondSharpest(bracket, levels.inverseDepth(l)));
  CostVolume volume(size, levels.count);
  cv::parallel_for_(
      {0, size.height},
      [&](const cv::Range& rows) {
        cv::Mat1f costs(levels.count, size.width);
        for (int y = rows.start; y < rows.end; ++y) {
          costs = 0;
          for (std::size_t k = 0; k < bracket.frames.size(); ++k) {
            const ObservedFrame& frame = bracket.frames[k];
            for (int l = 0; l < levels.count; ++l) {
              const float radius = frame.blur.radius(levels.inverseDepth(l));
              const double variance =
                  2 * bracket.noise_variance + kDepth.variance + kDepth.model_error * radius * radius;
              addCosts(pictures.at(beyond_sharpest[l][k]).ptr<short>(y), frame.codes.ptr<short>(y),
                       frame.shown[y], static_cast<float>(1 / (3 * variance * kCodeScale * kCodeScale)),
                       kDepth.most_cost, size.width, costs[l]);
            }
          }
          for (int x = 0; x < size.width; ++x) {
            const float seen = texture(y, x),
                        measured = bracket.measured.empty() ? 0 : bracket.measured(y, x);
            for (int l = 0; l < levels.count && seen < 1; ++l)
              costs(l, x) = seen * costs(l, x) + (l > 0 ? (1 - seen) * kDepth.nearer : 0);
            for (int l = 0; l < levels.count && measured > 0; ++l)
              costs(l, x) += beside_measured[std::abs(l - levels.nearest(measured))];
            std::int16_t* to = volume.at(y, x);
            for (int l = 0; l < levels.count; ++l)
              to[l] = static_cast<std::int16_t>(kCostScale * costs(l, x) + 0.5f);
          }
        }
      },
      stripCount(size.height));
  return volume;
}

// At the border blur brings in light from outside the picture, which no prediction knows. The estimate is
// replaced by that of the nearest pixel farther inside.
void continueAtBorder(cv::Mat1f& inverse_depth) {
  const cv::Rect inside(kDepth.border, kDepth.border, inverse_depth.cols - 2 * kDepth.border,
                        inverse_depth.rows - 2 * kDepth.border);
  if (inside.width <= 0 || inside.height <= 0) return;
  cv::copyMakeBorder(inverse_depth(inside).clone(), inverse_depth, kDepth.border, kDepth.border,
                     kDepth.border, kDepth.border, cv::BORDER_REPLICATE);
}

// Index of the least of `count` costs, refined to a fraction by a parabola through it and its neighbours.
double lowest(const std::int16_t* costs, int count) {
  const int i = static_cast<int>(std::min_element(costs, costs + count) - costs);
  if (i == 0 || i == count - 1) return i;
  const double curvature = costs[i - 1] - 2.0 * costs[i] + costs[i + 1];
  return curvature > 0 ? i + (costs[i - 1] - costs[i + 1]) / (2 * curvature) : i;
}

}  // namespace

cv::Mat1f depthFromBracket(const ObservedBracket& bracket, const BlurredPictures& pictures,
                           const InverseDepthRange& range) {
  const Levels levels = makeLevels(bracket, range);
  const CostVolume volume = aggregateAlongPaths(costsOf(bracket, pictures, levels), bracket.fused,
                                                static_cast<int>(kDepth.small_step * kCostScale),
                                                static_cast<int>(kDepth.jump * kCostScale));
  cv::Mat1f inverse_depth(volume.size);
  inParallel(inverse_depth.rows, [&](int y) {
    for (int x = 0; x < inverse_depth.cols; ++x)
      inverse_depth(y, x) = levels.inverseDepth(lowest(volume.at(y, x), levels.count));
  });
  if (bracket.measured.empty()) {  // else measured depth knows the border better than the pixels inside do
    continueAtBorder(inverse_depth);
    return inverse_depth;
  }
  const cv::Mat1f clear = distanceFromDoubt(bracket);
  const float take = bracket.gap(kDepth.take);
  for (int y = 0; y < inverse_depth.rows; ++y) {
    for (int x = 0; x < inverse_depth.cols; ++x) {
      const float measured = bracket.measured(y, x);
      if (measured > 0 && (clear(y, x) > kDepth.clear || std::abs(measured - inverse_depth(y, x)) < take))
        inverse_depth(y, x) = measured;
    }
  }
  return inverse_depth;
}

}  // namespace all_in_focus::core
