// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "optics/blur_evidence.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "util/median.hpp"
#include "util/row_strips.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kTile = 12;      // px
constexpr int kDepthGrid = 4;  // px, at which depth is looked up in a tile
// Squared gray levels, of a pixel. It may show what lies hidden in the fused picture.
constexpr float kMostError = 100;
constexpr double kRounding = 0.2;   // squared gray levels: both pictures have been rounded
constexpr double kLeastBlur = 0.1;  // share that discs must explain: noise lets them explain some
constexpr int kDepths = 48;         // tried for a tile without measured depth
constexpr double kBeyond = 0.05;  // of the span of focus distances, to either side: where depth is tried, too
constexpr int kScales = 20;       // tried up to a factor of two
constexpr double kNoMore = 0.002;  // share of what discs explain, at which no wider ones are tried
// The error changes slowly between them; discs up to the first lie within their pixel.
constexpr std::array<float, 18> kRadii = {0.5, 0.625, 0.75, 0.875, 1, 1.25, 1.5, 1.75, 2,
                                          2.5, 3,     3.5,  4,     5, 6.5,  8.5, 11,   16};

// Place of a variance among those of kRadii, with a fraction.
double placeOf(double variance) {
  static const std::array<double, kRadii.size()> variances = [] {
    std::array<double, kRadii.size()> of{};
    std::transform(kRadii.begin(), kRadii.end(), of.begin(),
                   [](float radius) { return DiscKernels::get().variance(radius); });
    return of;
  }();
  if (variance >= variances.back()) return kRadii.size() - 1;
  const auto above = std::upper_bound(variances.begin(), variances.end(), variance);
  const auto below = above - 1;
  return static_cast<double>(below - variances.begin()) + (variance - *below) / (*above - *below);
}

// out = codes of light
void toCodes(const cv::Mat1f& light, const LightCurve& curve, cv::Mat1f& out) {
  out.create(light.size());
  inParallel(light.rows, [&](int y) {
    for (int x = 0; x < light.cols; ++x) out(y, x) = curve.code(light(y, x));
  });
}

float errorOf(const cv::Mat1f& a, const cv::Mat1f& b, const cv::Rect& at) {
  float sum = 0;
  for (int y = at.y; y < at.br().y; ++y) {
    for (int x = at.x; x < at.br().x; ++x) {
      const float difference = a(y, x) - b(y, x);
      sum += std::min(difference * difference, kMostError);
    }
  }
  return sum / static_cast<float>(at.area());
}

}  // namespace

double BlurEvidence::shrinking(const cv::Size& size, double pixels) {
  return std::max(1.0, std::sqrt(size.area() / pixels));
}

cv::Mat BlurEvidence::copyOf(const cv::Mat& image, double shrinking) {
  const auto shrunk = [&](int length) { return static_cast<int>(length / shrinking); };
  const cv::Size size(shrunk(image.cols), shrunk(image.rows));
  const cv::Rect all(0, 0, cvRound(size.width * shrinking), cvRound(size.height * shrinking));
  cv::Mat copy;
  cv::resize(image(all), copy, size, 0, 0, cv::INTER_AREA);
  return copy;
}

BlurEvidence::BlurEvidence(const cv::Mat1b& fused, const std::vector<Frame>& frames, const LightCurve& curve,
                           const cv::Mat1f& inverse_depth, double shrinking)
    : pixels_(shrinking * shrinking) {
  std::vector<cv::Rect> places;
  for (int y = 0; y + kTile <= fused.rows; y += kTile) {
    for (int x = 0; x + kTile <= fused.cols; x += kTile) places.emplace_back(x, y, kTile, kTile);
  }
  tiles_.resize(places.size());
  for (std::size_t t = 0; t < tiles_.size(); ++t) {
    for (int y = kDepthGrid / 2; y < kTile && !inverse_depth.empty(); y += kDepthGrid) {
      for (int x = kDepthGrid / 2; x < kTile; x += kDepthGrid) {
        if (const float depth = inverse_depth(places[t].tl() + cv::Point(x, y)); depth > 0)
          tiles_[t].depths.push_back(depth);
      }
    }
    tiles_[t].middle = median(tiles_[t].depths);
    has_depth_ = has_depth_ || !tiles_[t].depths.empty();
    for (const Frame& frame : frames) {
      const bool seen = (places[t] & frame.seen) == places[t];
      tiles_[t].errors.emplace_back(seen ? 1 : 0);
    }
  }
  const cv::Mat light = linearLight(fused, curve);
  cv::Mat blurred;
  cv::Mat1f codes;
  for (std::size_t r = 0; r < kRadii.size(); ++r) {
    blurByDisc(light, kRadii[r], blurred);
    toCodes(blurred, curve, codes);
    inParallel(static_cast<int>(places.size()), [&](int t) {
      for (std::size_t k = 0; k < frames.size(); ++k) {
        std::vector<float>& errors = tiles_[t].errors[k];
        if (errors.empty()) continue;
        errors.resize(r + 1);
        errors[r] = errorOf(codes, frames[k].gray, places[t]);
      }
    });
    const double before = least_;
    sumErrors();
    if (r > 0 && before - least_ < kNoMore * (unblurred_ - least_)) break;
  }
}

void BlurEvidence::sumErrors() {
  compared_ = 0;
  unblurred_ = least_ = 0;
  for (const Tile& tile : tiles_) {
    for (const std::vector<float>& errors : tile.errors) {
      if (errors.empty()) continue;
      ++compared_;
      unblurred_ += errors[0];
      least_ += *std::min_element(errors.begin(), errors.end());
    }
  }
}

BlurEvidence BlurEvidence::withoutDepth() const {
  BlurEvidence evidence = *this;
  for (Tile& tile : evidence.tiles_) tile.depths.clear();
  evidence.has_depth_ = false;
  return evidence;
}

bool BlurEvidence::showsBlur() const {
  return unblurred_ > (1 + kLeastBlur) * (least_ + kRounding * compared_);
}

// Of a tile, summed over frames. The fused picture has the blur of the sharpest frame already.
double BlurEvidence::error(const Tile& tile, const std::vector<FrameBlur>& blur, double scale,
                           double inverse_depth) const {
  const DiscKernels& discs = DiscKernels::get();
  const auto variance = [&](std::size_t k) {
    return discs.variance(scale * blur[k].radius(static_cast<float>(inverse_depth)));
  };
  double sharpest = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < blur.size(); ++k) {
    if (!tile.errors[k].empty()) sharpest = std::min(sharpest, variance(k));
  }
  double sum = 0;
  for (std::size_t k = 0; k < blur.size(); ++k) {
    const std::vector<float>& errors = tile.errors[k];
    if (errors.empty()) continue;
    // To discs that are wider than those tried the error of the last one is ascribed.
    const double place = std::min(placeOf(std::max(0.0, variance(k) - sharpest) / pixels_),
                                  static_cast<double>(errors.size() - 1));
    const auto below = std::min(static_cast<std::size_t>(place), errors.size() - 2);
    const double share = place - static_cast<double>(below);
    sum += (1 - share) * errors[below] + share * errors[below + 1];
  }
  return sum;
}

double BlurEvidence::explained(const std::vector<FrameBlur>& blur, double scale) const {
  const auto ends = std::minmax_element(blur.begin(), blur.end(), [](const FrameBlur& a, const FrameBlur& b) {
    return a.inverse_depth < b.inverse_depth;
  });
  const double least = ends.first->inverse_depth, span = ends.second->inverse_depth - least;
  std::vector<double> left(tiles_.size());
  inParallel(static_cast<int>(tiles_.size()), [&](int t) {
    const Tile& tile = tiles_[t];
    left[t] = std::numeric_limits<double>::infinity();
    const auto tryDepth = [&](double depth) { left[t] = std::min(left[t], error(tile, blur, scale, depth)); };
    for (const float depth : tile.depths) tryDepth(depth);
    for (int i = 0; i < kDepths && tile.depths.empty(); ++i)
      tryDepth(least + span * ((1 + 2 * kBeyond) * i / (kDepths - 1) - kBeyond));
  });
  double sum = 0;
  for (const double of_tile : left) sum += of_tile;
  return (unblurred_ - sum) / std::max(unblurred_ - least_, 1e-9);
}

double BlurEvidence::typicalScale(const std::vector<FrameBlur>& blur, double near) const {
  struct OfTile {
    double scale = 1, weight = 0;
  };
  std::vector<OfTile> found(tiles_.size());
  inParallel(static_cast<int>(tiles_.size()), [&](int t) {
    const Tile& tile = tiles_[t];
    if (tile.depths.empty()) return;
    const double unblurred = error(tile, blur, 0, tile.middle);
    for (int i = -kScales; i <= kScales; ++i) {
      const double scale = near * std::pow(2, static_cast<double>(i) / kScales);
      const double gain = unblurred - error(tile, blur, scale, tile.middle);
      if (gain > found[t].weight) found[t] = {scale, gain};
    }
  });
  std::sort(found.begin(), found.end(), [](const OfTile& a, const OfTile& b) { return a.scale < b.scale; });
  double all = 0, below = 0;
  for (const OfTile& tile : found) all += tile.weight;
  for (const OfTile& tile : found) {
    below += tile.weight;
    if (2 * below >= all && all > 0) return tile.scale;
  }
  return near;
}

}  // namespace all_in_focus::core
