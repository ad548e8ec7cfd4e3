// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/contours.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "restoration/light.hpp"
#include "util/row_strips.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kSweeps = 8, kSweepsPerUpdate = 3;
constexpr int kReachPx = 4;      // how far a contour may move
constexpr int kStirPx = 2;       // a change is felt that far away
constexpr float kSharpPx = 3;    // radius of frames that tell
constexpr float kMostCost = 30;  // of a frame
constexpr float kJumpWeight = 2;
constexpr float kColorStep = 288;  // squared gray levels, of jumps that cost little
constexpr float kLeastJump = 0.05f;
constexpr float kExplained = 1;  // mean cost, 3 x 3, of what needs no better depth

const std::array<cv::Point, 4> kNeighbours = {cv::Point(-1, 0), {1, 0}, {0, -1}, {0, 1}};

class Contours {
 public:
  Contours(const ObservedBracket& bracket, std::vector<ImageFormation>& formation, cv::Mat1f& closeness)
      : bracket_(bracket),
        formation_(formation),
        closeness_(closeness),
        gap_(bracket.gap(kJumpPx)),
        cost_scale_(static_cast<float>(1 / (6 * (bracket.noise_variance + 1) * kCodeScale * kCodeScale))),
        stirred_(closeness.size()) {
    cv::dilate(jumps(closeness, gap_), within_,
               cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * kReachPx + 1, 2 * kReachPx + 1}));
    within_.copyTo(stirred_);
  }

  // Tries every second pixel near which something has changed since it was tried last; returns how many move.
  int sweep(int parity) {
    const RowStrips strips({0, closeness_.rows}, std::max(1, closeness_.rows / 16));
    std::vector<std::vector<Move>> moves(strips.count());
    strips.forEach([&](const cv::Range& rows, int strip) {
      std::vector<ImageFormation::Part> parts;
      for (int y = rows.start; y < rows.end; ++y) {
        for (int x = (y + parity) % 2; x < closeness_.cols; x += 2) {
          if (!stirred_(y, x)) continue;
          stirred_(y, x) = 0;
          const float own = closeness_(y, x), best = bestOf({x, y}, parts);
          if (best != own) moves[strip].push_back({{x, y}, best});
        }
      }
    });
    std::vector<cv::Point> changed;
    for (const std::vector<Move>& of_strip : moves) {
      for (const Move& move : of_strip) {
        closeness_(move.at) = move.to;
        changed.push_back(move.at);
        stir(move.at);
      }
    }
    for (ImageFormation& one : formation_) one.update(changed);
    return static_cast<int>(changed.size());
  }

 private:
  bool inside(const cv::Point& p) const { return cv::Rect({}, closeness_.size()).contains(p); }

  struct Move {
    cv::Point at;
    float to;
  };

  void stir(const cv::Point& p) {
    const cv::Rect around = cv::Rect(p.x - kStirPx, p.y - kStirPx, 2 * kStirPx + 1, 2 * kStirPx + 1) &
                            cv::Rect({}, closeness_.size());
    cv::bitwise_or(stirred_(around), within_(around), stirred_(around));
  }

  // The closeness of a pixel or of a neighbour, whichever explains the frames best.
  float bestOf(const cv::Point& p, std::vector<ImageFormation::Part>& parts) const {
    float best = closeness_(p);
    std::array<float, 4> candidates;
    int count = 0;
    for (const cv::Point& step : kNeighbours) {
      if (!inside(p + step)) continue;
      const float other = closeness_(p + step);
      if (std::abs(other - best) <= gap_) continue;
      const bool known = std::any_of(candidates.begin(), candidates.begin() + count,
                                     [&](float c) { return std::abs(c - other) < gap_ / 4; });
      if (!known) candidates[count++] = other;
    }
    for (int i = 0; i < count; ++i) {
      const float tried = candidates[i];
      const std::vector<int> frames = telling(best, tried, p);
      if (frames.empty()) continue;
      const float before = cost(p, best, frames, parts);
      if (before < kExplained) continue;
      if (cost(p, tried, frames, parts) + jumpCost(p, tried) < before + jumpCost(p, best)) best = tried;
    }
    return best;
  }

  // The two frames that are sharpest at either closeness.
  std::vector<int> telling(float a, float b, const cv::Point& p) const {
    std::vector<int> frames;
    for (const float closeness : {a, b}) {
      std::array<int, 2> sharpest = {-1, -1};
      for (int k = 0; k < static_cast<int>(bracket_.frames.size()); ++k) {
        if (!bracket_.frames[k].seen.contains(p)) continue;
        const auto radius = [&](int i) { return bracket_.frames[i].blur.radius(closeness); };
        if (radius(k) > kSharpPx) continue;
        if (sharpest[0] < 0 || radius(k) < radius(sharpest[0])) {
          sharpest[1] = sharpest[0];
          sharpest[0] = k;
        } else if (sharpest[1] < 0 || radius(k) < radius(sharpest[1])) {
          sharpest[1] = k;
        }
      }
      for (const int k : sharpest) {
        if (k >= 0 && std::find(frames.begin(), frames.end(), k) == frames.end()) frames.push_back(k);
      }
    }
    return frames;
  }

  // How badly a closeness explains the frames at a pixel.
  float cost(const cv::Point& p, float closeness, const std::vector<int>& frames,
             std::vector<ImageFormation::Part>& parts) const {
    const LightCurve& curve = LightCurve::get();
    float sum = 0;
    for (const int k : frames) {
      formation_[k].partsOf(p, closeness, parts);
      cv::Vec3f light;
      for (const ImageFormation::Part& part : parts)
        light += part.share * bracket_.light(p.y + part.dy, p.x + part.dx);
      const cv::Vec3s& seen = bracket_.frames[k].codes(p);
      float squared = 0;
      for (int c = 0; c < 3; ++c) {
        const float difference = kCodeScale * curve.code(light[c]) - seen[c];
        squared += difference * difference;
      }
      sum += std::min(kMostCost, squared * cost_scale_);
    }
    return sum;
  }

  float jumpCost(const cv::Point& p, float closeness) const {
    float sum = 0;
    for (const cv::Point& step : kNeighbours) {
      if (!inside(p + step) || std::abs(closeness_(p + step) - closeness) <= gap_) continue;
      const cv::Vec3b &a = bracket_.fused(p), &b = bracket_.fused(p + step);
      float squared = 0;
      for (int c = 0; c < 3; ++c) squared += static_cast<float>((a[c] - b[c]) * (a[c] - b[c])) / 3;
      sum += std::exp(-squared / kColorStep) + kLeastJump;
    }
    return kJumpWeight * sum;
  }

  const ObservedBracket& bracket_;
  std::vector<ImageFormation>& formation_;
  cv::Mat1f& closeness_;
  float gap_, cost_scale_;
  cv::Mat1b within_, stirred_;  // within_: where contours may run
};

}  // namespace

void moveContours(const ObservedBracket& bracket, std::vector<ImageFormation>& formation,
                  cv::Mat1f& closeness, const std::function<bool(double)>& proceed) {
  Contours contours(bracket, formation, closeness);
  for (int i = 0; i < kSweeps; ++i) {
    if (!proceed(static_cast<double>(i) / kSweeps)) return;
    if (contours.sweep(0) + contours.sweep(1) == 0) break;
    if (i % kSweepsPerUpdate == kSweepsPerUpdate - 1) updateAll(formation);
  }
  updateAll(formation);
}

}  // namespace all_in_focus::core
