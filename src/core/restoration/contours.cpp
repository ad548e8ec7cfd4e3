// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/contours.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "util/row_strips.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {
namespace {

constexpr struct ContourParameters {
  int sweeps = 4, sweeps_per_update = 3;
  int reach = 4;    // px; how far a contour may move
  int effect = 2;   // px; a pixel that changes has an effect on others up to there
  float sharp = 3;  // px: radius of frames that are compared
  // Costs: squared errors over their variance. Gray levels squared: what is hidden beside a contour, and its
  // place within a pixel, are not known. (1: -0.4 dB.)
  double model_variance = 9;
  float most_cost = 60;  // of a frame
  // Of a jump, where colours differ by little: by exp(-squared gray levels / color_step). Along a contour
  // only a share of them counts: where it moves they move with it.
  float jump_weight = 5, color_step = 288, sideways = 0.5f;
  float near_excess = 2.5f;    // what the nearer of two depths must explain better
  float contradicted = 5;      // what a depth that registration contradicts must explain better
  float nearer_than_all = 20;  // the same if registration says nothing so near within `near`
  int near = 8;                // px; no contour of registration is farther off
  int rim = 2;                 // px by which registration may make near objects too wide
  // Gray levels: of a pixel's colour from that of the fused picture, if its depth is the farther or the
  // nearer. (One colour: -0.8 dB, 60 for both: -0.1.)
  float far_color_deviation = 60, near_color_deviation = 12;
} kContours{};

const std::array<cv::Point, 4> kNeighbours = {cv::Point(-1, 0), {1, 0}, {0, -1}, {0, 1}};

cv::Mat square(int reach) {
  return cv::getStructuringElement(cv::MORPH_RECT, {2 * reach + 1, 2 * reach + 1});
}

bool inside(const cv::Mat& picture, const cv::Point& p) {
  return cv::Rect({}, picture.size()).contains(p);
}

// How well depth explains the frames.
class Explanation {
 public:
  Explanation(const ObservedBracket& bracket, const std::vector<ImageFormation>& formation)
      : bracket_(bracket),
        formation_(formation),
        cost_scale_(static_cast<float>(
            1 / (6 * (bracket.noise_variance + kContours.model_variance) * kCodeScale * kCodeScale))),
        sharp_(ImageFormation::withMargin(bracket.light)) {}

  // Up to four frames of a pixel.
  struct Frames {
    std::array<int, 4> at;
    int count = 0;
  };

  // The two frames that are sharpest at either inverse depth, those that are not too blurred.
  Frames sharpestFrames(float a, float b, const cv::Point& p) const {
    Frames frames;
    for (const float inverse_depth : {a, b}) {
      const auto radius = [&](int k) { return bracket_.frames[k].blur.radius(inverse_depth); };
      int first = -1;
      for (int i = 0; i < 2; ++i) {
        int sharpest = -1;
        for (int k = 0; k < static_cast<int>(bracket_.frames.size()); ++k) {
          if (k == first || !bracket_.frames[k].shown(p) || radius(k) > kContours.sharp) continue;
          if (sharpest < 0 || radius(k) < radius(sharpest)) sharpest = k;
        }
        const auto end = frames.at.begin() + frames.count;
        if (sharpest >= 0 && std::find(frames.at.begin(), end, sharpest) == end)
          frames.at[frames.count++] = sharpest;
        first = sharpest;
      }
    }
    return frames;
  }

  // How badly an inverse depth explains some frames at a pixel. The fused picture may show the blur or the
  // colour of a nearer object at p, which the frames would contradict whatever the depth. So p has the colour
  // that explains them best, by least squares. color_deviation: how far that may be from the fused picture's.
  float costOf(const cv::Point& p, float inverse_depth, const Frames& frames, float color_deviation) const {
    const LightCurve& curve = *bracket_.curve;
    std::array<ImageFormation::Prediction, 4> predictions;
    for (int k = 0; k < frames.count; ++k)
      predictions[k] = formation_[frames.at[k]].predict(p, inverse_depth, sharp_);
    std::array<float, 4> squared = {};
    float cost = 0;
    for (int c = 0; c < 3; ++c) {
      const auto seen = [&](int k) { return bracket_.frames[frames.at[k]].codes(p)[c]; };
      const float fused = bracket_.light(p)[c];
      const float deviation = color_deviation / curve.slope(curve.code(fused));  // in light
      float weight = 1 / cost_scale_, sum = 0;
      for (int k = 0; k < frames.count; ++k) {
        const auto& [light, own_share] = predictions[k];
        const float code = curve.code(light[c]);
        const float gain = kCodeScale * own_share * curve.slope(code) * deviation;
        weight += gain * gain;
        sum += gain * (seen(k) - kCodeScale * code);
      }
      const float deviations = sum / weight;
      cost += deviations * deviations;
      const float change = std::clamp(fused + deviations * deviation, 0.0f, curve.light(255)) - fused;
      for (int k = 0; k < frames.count; ++k) {
        const auto& [light, own_share] = predictions[k];
        const float left = kCodeScale * curve.code(light[c] + own_share * change) - seen(k);
        squared[k] += left * left;
      }
    }
    for (int k = 0; k < frames.count; ++k) cost += std::min(kContours.most_cost, squared[k] * cost_scale_);
    return cost;
  }

 private:
  const ObservedBracket& bracket_;
  const std::vector<ImageFormation>& formation_;
  float cost_scale_;
  cv::Mat4f sharp_;
};

class Contours {
 public:
  Contours(const ObservedBracket& bracket, std::vector<ImageFormation>& formation, cv::Mat1f& inverse_depth,
           float stiffness)
      : bracket_(bracket),
        formation_(formation),
        inverse_depth_(inverse_depth),
        gap_(bracket.gap(kJumpPx)),
        explanation_(bracket, formation),
        pending_(inverse_depth.size()) {
    findJumpCosts(stiffness);
    if (!bracket.filled.empty()) cv::dilate(bracket.filled, nearest_, square(kContours.near));
    if (!bracket.measured.empty()) cv::erode(bracket.measured, farthest_, square(kContours.rim));
    within_ = besideJumps(inverse_depth, gap_, kContours.reach);
    within_.copyTo(pending_);
  }

  // Tries every second pixel of those that are pending; returns how many change. They do not see each other:
  // only neighbours, and the formation as it was.
  int sweep(int parity) {
    cv::Mat1b changed(inverse_depth_.size(), 0), nearby;
    inParallel(inverse_depth_.rows, [&](int y) {
      for (int x = (y + parity) % 2; x < inverse_depth_.cols; x += 2) {
        if (!pending_(y, x)) continue;
        pending_(y, x) = 0;
        const float best = bestOf({x, y});
        if (best == inverse_depth_(y, x)) continue;
        inverse_depth_(y, x) = best;
        changed(y, x) = 255;
      }
    });
    std::vector<cv::Point> places;
    cv::findNonZero(changed, places);
    cv::dilate(changed, nearby, square(kContours.effect));
    pending_ |= nearby & within_;
    inParallel(static_cast<int>(formation_.size()), [&](int k) { formation_[k].update(places); });
    return static_cast<int>(places.size());
  }

 private:
  // The inverse depth of a pixel or of a neighbour, whichever explains the frames best.
  float bestOf(const cv::Point& p) const {
    float best = inverse_depth_(p);
    std::array<float, 4> candidates;
    std::array<bool, 4> across_x;
    int count = 0;
    for (const cv::Point& step : kNeighbours) {
      if (!inside(inverse_depth_, p + step)) continue;
      const float other = inverse_depth_(p + step);
      if (std::abs(other - best) <= gap_ || isNearerThanAll(p, other)) continue;
      const bool known = std::any_of(candidates.begin(), candidates.begin() + count,
                                     [&](float c) { return std::abs(c - other) < gap_ / 4; });
      if (known) continue;
      across_x[count] = step.y == 0;
      candidates[count++] = other;
    }
    for (int i = 0; i < count; ++i) {
      const float near = std::max(best, candidates[i]), far = std::min(best, candidates[i]);
      const auto frames = explanation_.sharpestFrames(best, candidates[i], p);
      const auto cost = [&](float inverse_depth, float color_deviation) {
        return explanation_.costOf(p, inverse_depth, frames, color_deviation) +
               jumpCost(p, inverse_depth, across_x[i]) + depthCost(p, inverse_depth);
      };
      const float excess = cost(near, kContours.near_color_deviation) + kContours.near_excess -
                           cost(far, kContours.far_color_deviation);
      if (excess != 0) best = excess < 0 ? near : far;
    }
    return best;
  }

  // Of a jump between a pixel and its right or lower neighbour: less at a colour edge.
  void findJumpCosts(float stiffness) {
    for (cv::Mat1f* costs : {&right_, &below_}) costs->create(inverse_depth_.size());
    inParallel(inverse_depth_.rows, [&](int y) {
      for (int x = 0; x < inverse_depth_.cols; ++x) {
        const cv::Vec3b& here = bracket_.fused(y, x);
        const auto cost = [&](const cv::Vec3b& other) {
          float squared = 0;
          for (int c = 0; c < 3; ++c)
            squared += static_cast<float>((here[c] - other[c]) * (here[c] - other[c])) / 3;
          return stiffness * kContours.jump_weight * std::exp(-squared / kContours.color_step);
        };
        if (x + 1 < inverse_depth_.cols) right_(y, x) = cost(bracket_.fused(y, x + 1));
        if (y + 1 < inverse_depth_.rows) below_(y, x) = cost(bracket_.fused(y + 1, x));
      }
    });
  }

  bool isNearerThanAll(const cv::Point& p, float inverse_depth) const {
    return !nearest_.empty() && nearest_(p) > 0 && inverse_depth - nearest_(p) > gap_;
  }

  // Registration and the blur beside near objects make these too fat rather than too thin. What registration
  // has missed, on the other hand, only the frames show. So a farther depth contradicts registration only
  // where it was measured all around.
  float depthCost(const cv::Point& p, float inverse_depth) const {
    if (isNearerThanAll(p, inverse_depth)) return kContours.nearer_than_all;
    const float filled = bracket_.filled.empty() ? 0 : bracket_.filled(p);
    const bool is_nearer = filled > 0 && inverse_depth - filled > gap_;
    const bool is_farther = !farthest_.empty() && farthest_(p) - inverse_depth > gap_;
    return is_nearer || is_farther ? kContours.contradicted : 0;
  }

  // across_x: the contour would move along x.
  float jumpCost(const cv::Point& p, float inverse_depth, bool across_x) const {
    float sum = 0;
    const auto add = [&](const cv::Point& step, float cost) {
      if (std::abs(inverse_depth_(p + step) - inverse_depth) > gap_)
        sum += (step.y == 0) == across_x ? cost : kContours.sideways * cost;
    };
    if (p.x > 0) add({-1, 0}, right_(p.y, p.x - 1));
    if (p.x + 1 < inverse_depth_.cols) add({1, 0}, right_(p));
    if (p.y > 0) add({0, -1}, below_(p.y - 1, p.x));
    if (p.y + 1 < inverse_depth_.rows) add({0, 1}, below_(p));
    return sum;
  }

  const ObservedBracket& bracket_;
  std::vector<ImageFormation>& formation_;
  cv::Mat1f& inverse_depth_;
  float gap_;
  Explanation explanation_;
  cv::Mat1f nearest_;        // of the filled depth nearby
  cv::Mat1f farthest_;       // of the measured depth within the rim, 0 where some is unknown
  cv::Mat1f right_, below_;  // cost of a jump to these neighbours
  cv::Mat1b within_;         // where contours may run
  cv::Mat1b pending_;        // something nearby has changed since the pixel was tried
};

}  // namespace

bool moveContours(const ObservedBracket& bracket, std::vector<ImageFormation>& formation,
                  cv::Mat1f& inverse_depth, float stiffness, const std::function<bool(double)>& proceed) {
  Contours contours(bracket, formation, inverse_depth, stiffness);
  for (int i = 0; i < kContours.sweeps; ++i) {
    if (!proceed(static_cast<double>(i) / kContours.sweeps)) return false;
    const int moved = contours.sweep(0);  // the second sweep sees what the first one moved
    if (contours.sweep(1) + moved == 0) break;
    if (i % kContours.sweeps_per_update == kContours.sweeps_per_update - 1) updateAll(formation);
  }
  updateAll(formation);
  return true;
}

}  // namespace all_in_focus::core
