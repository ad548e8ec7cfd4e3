// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/image_formation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace all_in_focus::core {
namespace {

constexpr std::array<int, 11> kReaches = {0, 1, 2, 3, 4, 5, 7, 9, 11, 14, DiscKernels::kLargestPx + 1};
constexpr float kWhole = 0.98f;   // shares that sum up to it lack nothing
constexpr int kMovedPx = 2;       // jumps may move by that before reaches are found anew
constexpr int kNearby = 5;        // px
constexpr float kNearest = 0.3f;  // weight of a pixel d away: 1 / (d^4 + this)

int mirrored(int i, int size) {
  return cv::borderInterpolate(i, size, cv::BORDER_REFLECT_101);
}

}  // namespace

ImageFormation::ImageFormation(const cv::Mat1f& closeness, const FrameBlur& blur, float layer_gap)
    : closeness_(closeness), blur_(blur) {
  double least = 0, largest = 0;
  cv::minMaxLoc(closeness, &least, &largest);
  least_ = static_cast<float>(least);
  per_layer_ = 1 / std::max(layer_gap, static_cast<float>((largest - least) / (kLayers - 1)));
}

void updateAll(std::vector<ImageFormation>& formation) {
  cv::parallel_for_({0, static_cast<int>(formation.size())}, [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k) formation[k].update();
  });
}

void ImageFormation::update() {
  const DiscKernels& kernels = DiscKernels::get();
  cv::Mat1b own(closeness_.size());
  index_.create(own.size());
  layer_.create(own.size());
  for (int y = 0; y < own.rows; ++y) {
    for (int x = 0; x < own.cols; ++x) {
      index_(y, x) = static_cast<std::uint8_t>(DiscKernels::index(blur_.radius(closeness_(y, x))));
      layer_(y, x) = static_cast<std::uint8_t>(layer(closeness_(y, x)));
      own(y, x) = static_cast<std::uint8_t>(kernels.reach(index_(y, x)));
    }
  }
  reach_ = cv::Mat1b::zeros(own.size());
  nearest_ = layer_.clone();
  cv::Mat wide, layers;
  for (size_t i = 1; i < kReaches.size(); ++i) {
    const cv::Mat as_wide = own > kReaches[i - 1];
    if (cv::countNonZero(as_wide) == 0) break;
    const int side = 2 * (kReaches[i] + kMovedPx) + 1;
    const cv::Mat square = cv::getStructuringElement(cv::MORPH_RECT, {side, side});
    cv::dilate(as_wide, wide, square);
    reach_.setTo(kReaches[i], wide);
    cv::dilate(layer_ & as_wide & (own <= kReaches[i]), layers, square);
    cv::max(nearest_, layers, nearest_);
  }
}

void ImageFormation::update(const std::vector<cv::Point>& changed) {
  for (const cv::Point& p : changed) {
    index_(p) = static_cast<std::uint8_t>(DiscKernels::index(blur_.radius(closeness_(p))));
    layer_(p) = static_cast<std::uint8_t>(layer(closeness_(p)));
  }
}

void ImageFormation::partsOf(const cv::Point& p, float own, std::vector<Part>& parts) const {
  const DiscKernels& kernels = DiscKernels::get();
  const int own_index = DiscKernels::index(blur_.radius(own));
  const int own_layer = layer(own), own_reach = kernels.reach(own_index);
  // Where nothing nearer comes into it the own disc is enough, if it is filled.
  if (nearest_(p) <= own_layer + 1) {
    if (own_reach == 0) {
      parts.assign(1, {0, 0, 1});
      return;
    }
    if (gather(p, own_index, own_layer, own_reach, parts) >= kWhole) return;
  }
  const float total = gather(p, own_index, own_layer, std::max<int>(reach_(p), own_reach), parts);
  if (total < kWhole) fillUp(p, own_layer, 1 - total, parts);
}

// Parts no farther than `half` away; returns the sum of their shares, which is 1 if it is nearly 1.
float ImageFormation::gather(const cv::Point& p, int own_index, int own_layer, int half,
                             std::vector<Part>& parts) const {
  const DiscKernels& kernels = DiscKernels::get();
  const bool inside =
      p.x >= half && p.y >= half && p.x + half < closeness_.cols && p.y + half < closeness_.rows;
  std::array<float, kLayers> sums;
  std::uint64_t present = 0;
  thread_local std::vector<std::uint8_t> layers;
  layers.clear();
  parts.clear();
  const auto take = [&](int dx, int dy, int to_x, int to_y, int index, int l) {
    const int u = std::abs(dx), v = std::abs(dy);
    if (std::max(u, v) > kernels.reach(index)) return;
    const float share = kernels.shares(index)[DiscKernels::kSide * v + u];
    if (share <= 0) return;
    if (!(present >> l & 1)) sums[l] = 0;
    present |= std::uint64_t{1} << l;
    sums[l] += share;
    parts.push_back({static_cast<std::int16_t>(to_x), static_cast<std::int16_t>(to_y), share});
    layers.push_back(static_cast<std::uint8_t>(l));
  };
  for (int dy = -half; dy <= half; ++dy) {
    const int to_y = inside ? dy : mirrored(p.y + dy, closeness_.rows) - p.y;
    const std::uint8_t* indices = index_[p.y + to_y] + p.x;
    const std::uint8_t* row = layer_[p.y + to_y] + p.x;
    for (int dx = -half; dx <= half; ++dx) {
      const int to_x = inside ? dx : mirrored(p.x + dx, closeness_.cols) - p.x;
      if (to_x == 0 && to_y == 0) {
        take(dx, dy, 0, 0, own_index, own_layer);
      } else {
        take(dx, dy, to_x, to_y, indices[to_x], row[to_x]);
      }
    }
  }
  // Nearest layers first, until the pixel has all its light.
  std::array<float, kLayers> factors;
  float total = 0;
  for (int l = kLayers - 1; l >= 0; --l) {
    if (!(present >> l & 1)) continue;
    factors[l] = std::clamp((1 - total) / sums[l], 0.0f, 1.0f);
    total += factors[l] * sums[l];
  }
  size_t kept = 0;
  for (size_t i = 0; i < parts.size(); ++i) {
    const float share = parts[i].share * factors[layers[i]];
    if (share > 0) parts[kept++] = {parts[i].dx, parts[i].dy, share};
  }
  parts.resize(kept);
  if (total >= kWhole) {
    for (Part& part : parts) part.share /= total;
  }
  return total;
}

// The share that no disc provides belongs to what is hidden: if something nearby covers p's own surface, to
// that surface; else to what lies behind p.
void ImageFormation::fillUp(const cv::Point& p, int own_layer, float missing,
                            std::vector<Part>& parts) const {
  const int left = std::max(-kNearby, -p.x), right = std::min(kNearby, closeness_.cols - 1 - p.x);
  const int top = std::max(-kNearby, -p.y), bottom = std::min(kNearby, closeness_.rows - 1 - p.y);
  std::array<std::uint8_t, (2 * kNearby + 1) * (2 * kNearby + 1)> layers;
  size_t i = 0;
  bool covered = false;
  for (int dy = top; dy <= bottom; ++dy) {
    const std::uint8_t* row = layer_[p.y + dy] + p.x;
    for (int dx = left; dx <= right; ++dx, ++i) {
      layers[i] = dx == 0 && dy == 0 ? static_cast<std::uint8_t>(own_layer) : row[dx];
      covered |= layers[i] > own_layer + 1;
    }
  }
  const int farther_than = covered ? own_layer + 2 : own_layer - 1;
  const size_t first = parts.size();
  float sum = 0;
  i = 0;
  for (int dy = top; dy <= bottom; ++dy) {
    for (int dx = left; dx <= right; ++dx, ++i) {
      if (layers[i] >= farther_than) continue;
      const float squared = static_cast<float>(dx * dx + dy * dy);
      const float weight = 1 / (squared * squared + kNearest);
      parts.push_back({static_cast<std::int16_t>(dx), static_cast<std::int16_t>(dy), weight});
      sum += weight;
    }
  }
  if (sum > 0) {
    for (size_t k = first; k < parts.size(); ++k) parts[k].share *= missing / sum;
  } else {
    for (Part& part : parts) part.share /= 1 - missing;
  }
}

}  // namespace all_in_focus::core
