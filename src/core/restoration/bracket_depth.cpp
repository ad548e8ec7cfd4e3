// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/bracket_depth.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "restoration/blur_scale.hpp"
#include "restoration/semi_global_matching.hpp"
#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kMostLevels = 48;
constexpr double kLevelPx = 0.22;  // of blur, between levels
constexpr int kMostFrames = 10;
constexpr float kMostCost = 12;       // of a frame; larger costs are cut, as it may show what no other does
constexpr double kVariance = 1;       // gray levels squared: of the fused picture
constexpr double kModelError = 0.36;  // and of the lens model, by squared radius
constexpr double kSmallStep = 1.5, kJump = 6;
constexpr double kCostScale = 24;  // of costs as integers
constexpr int kWindow = 4;         // px; measured depth counts that far around its pixel
constexpr float kNearWeight = 1.5f, kMeasuredWeight = 1.5f, kFilledWeight = 0.6f;
constexpr float kAgreePx = 0.25f, kDifferPx = 0.75f;  // of blur
constexpr float kTakePx = 0.45f;  // of blur; measured depth that differs by less replaces the estimate
constexpr float kClearPx = 6;
constexpr int kBorder = 3;  // px

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
  const float span = range.largest - range.least, gap = bracket.gap(kLevelPx);
  const int count = std::clamp(static_cast<int>(std::ceil(span / gap)) + 1, 2, kMostLevels);
  return {range.least, std::max(span / static_cast<float>(count - 1), gap), count};
}

// costs[x] += least of the most and the squared difference of two rows of codes times a factor.
ALL_IN_FOCUS_SIMD void addCosts(const short* a, const short* b, float factor, float most, int n,
                                float* costs) {
  for (int x = 0; x < n; ++x) {
    const int d0 = a[3 * x] - b[3 * x], d1 = a[3 * x + 1] - b[3 * x + 1], d2 = a[3 * x + 2] - b[3 * x + 2];
    costs[x] += std::min(most, static_cast<float>(d0 * d0 + d1 * d1 + d2 * d2) * factor);
  }
}

// Frames spread evenly over those there are.
std::vector<const ObservedFrame*> compared(const ObservedBracket& bracket) {
  const int there = static_cast<int>(bracket.frames.size()), taken = std::min(there, kMostFrames);
  std::vector<const ObservedFrame*> frames;
  frames.reserve(taken);
  for (int i = 0; i < taken; ++i)
    frames.push_back(&bracket.frames[taken == 1 ? 0 : (2 * i * (there - 1) + taken - 1) / (2 * (taken - 1))]);
  return frames;
}

// The cost of each level by measured depth.
class MeasuredPrior {
 public:
  MeasuredPrior(const ObservedBracket& bracket, const Levels& levels)
      : bracket_(bracket), levels_(levels), against_(levels.count) {
    const float px = levels.step * static_cast<float>(bracket.px_mm);
    for (int i = 0; i < levels.count; ++i)
      against_[i] = std::clamp((static_cast<float>(i) * px - kAgreePx) / (kDifferPx - kAgreePx), 0.0f, 1.0f);
    const auto clear = std::find(against_.begin(), against_.end(), 1.0f);
    reach_ = std::min(static_cast<int>(clear - against_.begin()), levels.count - 1);
  }

  // Adds to the costs of row y; costs(level)[x].
  void addTo(int y, cv::Mat1f& costs) {
    const int cols = costs.cols, count = levels_.count;
    windowOf(y);
    for (int x = 0; x < cols; ++x) {
      const float density = static_cast<float>(seen_[x]) / ((2 * kWindow + 1) * (2 * kWindow + 1));
      const float filled = bracket_.filled(y, x), own = bracket_.measured(y, x);
      if (density == 0 && filled == 0) continue;
      const int filled_level = levels_.nearest(filled), own_level = levels_.nearest(own);
      distances(present_[x]);
      for (int l = 0; l < count; ++l) {
        float cost = 0;
        if (density > 0) cost += kNearWeight * density * against_[distance_[l]];
        if (own > 0) cost += kMeasuredWeight * against_[std::abs(l - own_level)];
        if (filled > 0) cost += kFilledWeight * against_[std::abs(l - filled_level)];
        costs(l, x) += cost;
      }
    }
  }

 private:
  // Levels present (a bit each), and how many pixels were measured, in the window about each pixel of row y.
  void windowOf(int y) {
    const int cols = bracket_.measured.cols, rows = bracket_.measured.rows;
    column_.assign(cols, 0);
    column_seen_.assign(cols, 0);
    for (int v = std::max(0, y - kWindow); v <= std::min(rows - 1, y + kWindow); ++v) {
      for (int x = 0; x < cols; ++x) {
        const float measured = bracket_.measured(v, x);
        if (measured <= 0) continue;
        column_[x] |= std::uint64_t{1} << levels_.nearest(measured);
        ++column_seen_[x];
      }
    }
    present_.assign(cols, 0);
    seen_.assign(cols, 0);
    for (int x = 0; x < cols; ++x) {
      for (int u = std::max(0, x - kWindow); u <= std::min(cols - 1, x + kWindow); ++u) {
        present_[x] |= column_[u];
        seen_[x] += column_seen_[u];
      }
    }
  }

  // Levels to the nearest one present, at most reach_.
  void distances(std::uint64_t present) {
    for (int l = 0; l < levels_.count; ++l) distance_[l] = present >> l & 1 ? 0 : reach_;
    for (int l = 1; l < levels_.count; ++l) distance_[l] = std::min(distance_[l], distance_[l - 1] + 1);
    for (int l = levels_.count - 2; l >= 0; --l) distance_[l] = std::min(distance_[l], distance_[l + 1] + 1);
  }

  const ObservedBracket& bracket_;
  Levels levels_;
  std::vector<float> against_;  // by distance in levels, 0..1
  int reach_ = 0;
  std::array<int, kMostLevels> distance_{};
  std::vector<std::uint64_t> column_, present_;
  std::vector<int> column_seen_, seen_;
};

CostVolume costsOf(const ObservedBracket& bracket, const BlurredPictures& pictures, const Levels& levels) {
  const cv::Size size = bracket.fused.size();
  const std::vector<const ObservedFrame*> frames = compared(bracket);
  CostVolume volume(size, levels.count);
  cv::parallel_for_(
      {0, size.height},
      [&](const cv::Range& rows) {
        cv::Mat1f costs(levels.count, size.width);
        MeasuredPrior prior(bracket, levels);
        for (int y = rows.start; y < rows.end; ++y) {
          costs = 0;
          for (const ObservedFrame* frame : frames) {
            if (y < frame->seen.y || y >= frame->seen.br().y) continue;
            for (int l = 0; l < levels.count; ++l) {
              const float radius = frame->blur.radius(levels.inverseDepth(l));
              const double variance = 2 * bracket.noise_variance + kVariance + kModelError * radius * radius;
              addCosts(pictures.at(radius).ptr<short>(y) + 3 * frame->seen.x,
                       frame->codes.ptr<short>(y) + 3 * frame->seen.x,
                       static_cast<float>(1 / (3 * variance * kCodeScale * kCodeScale)), kMostCost,
                       frame->seen.width, costs.ptr<float>(l) + frame->seen.x);
            }
          }
          if (!bracket.measured.empty()) prior.addTo(y, costs);
          for (int x = 0; x < size.width; ++x) {
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
  const cv::Rect inside(kBorder, kBorder, inverse_depth.cols - 2 * kBorder, inverse_depth.rows - 2 * kBorder);
  if (inside.width <= 0 || inside.height <= 0) return;
  cv::copyMakeBorder(inverse_depth(inside).clone(), inverse_depth, kBorder, kBorder, kBorder, kBorder,
                     cv::BORDER_REPLICATE);
}

}  // namespace

cv::Mat1f depthFromBracket(const ObservedBracket& bracket, const BlurredPictures& pictures,
                           const InverseDepthRange& range) {
  const Levels levels = makeLevels(bracket, range);
  const CostVolume volume =
      aggregateAlongPaths(costsOf(bracket, pictures, levels), bracket.fused,
                          static_cast<int>(kSmallStep * kCostScale), static_cast<int>(kJump * kCostScale));
  cv::Mat1f inverse_depth(volume.size);
  forEachRow(inverse_depth.rows, [&](int y) {
    for (int x = 0; x < inverse_depth.cols; ++x)
      inverse_depth(y, x) = levels.inverseDepth(lowest(volume.at(y, x), levels.count));
  });
  if (bracket.measured.empty()) {  // else measured depth knows the border better than the pixels inside do
    continueAtBorder(inverse_depth);
    return inverse_depth;
  }
  const cv::Mat1f clear = distanceFromDoubt(bracket);
  for (int y = 0; y < inverse_depth.rows; ++y) {
    for (int x = 0; x < inverse_depth.cols; ++x) {
      const float measured = bracket.measured(y, x);
      if (measured > 0 &&
          (clear(y, x) > kClearPx || std::abs(measured - inverse_depth(y, x)) < bracket.gap(kTakePx)))
        inverse_depth(y, x) = measured;
    }
  }
  return inverse_depth;
}

}  // namespace all_in_focus::core
