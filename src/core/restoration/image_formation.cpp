// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/image_formation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/imgproc.hpp>

#include "util/row_strips.hpp"

namespace all_in_focus::core {
namespace {

constexpr std::array<int, 11> kReaches = {0, 1, 2, 3, 4, 5, 7, 9, 11, 14, DiscKernels::kLargestPx + 1};
constexpr float kWhole = 0.98f;  // shares that sum up to it lack nothing
constexpr int kMovedPx = 2;      // jumps may move by that before reaches are found anew
constexpr int kNearby = 5, kNearbySide = 2 * kNearby + 1;  // px
constexpr float kNearest = 0.3f;                           // weight of a pixel d away: 1 / (d^4 + this)
constexpr int kMostParts = (2 * DiscKernels::kSide + 1) * (2 * DiscKernels::kSide + 1);
constexpr int kBlock = cv::v_uint8x16::nlanes;  // columns looked at together

int mirrored(int i, int size) {
  return i >= 0 && i < size ? i : cv::borderInterpolate(i, size, cv::BORDER_REFLECT_101);
}

// Weights of hidden pixels by kNearbySide dy + dx.
const std::array<float, kNearbySide * kNearbySide>& nearbyWeights() {
  static const auto weights = [] {
    std::array<float, kNearbySide * kNearbySide> table{};
    for (int dy = -kNearby, i = 0; dy <= kNearby; ++dy) {
      for (int dx = -kNearby; dx <= kNearby; ++dx, ++i) {
        const float squared = static_cast<float>(dx * dx + dy * dy);
        table[i] = 1 / (squared * squared + kNearest);
      }
    }
    return table;
  }();
  return weights;
}

}  // namespace

// An inverse depth that a pixel may have.
struct ImageFormation::Candidate {
  int index, layer, reach;
};

// What lights up a pixel.
struct ImageFormation::Lights {
  int count = 0;
  float total = 0;  // of their shares, once factors are applied
  std::array<std::int8_t, kMostParts> dx, dy;
  std::array<float, kMostParts> shares;
  std::array<std::uint8_t, kMostParts> layers;
  std::array<float, kLayers> factors;  // on shares, by layer
};

// What is hidden at a pixel: what lies farther nearby.
struct ImageFormation::Hidden {
  std::array<int, kNearbySide * kNearbySide> at;  // kNearbySide dy + dx
  int count = 0;
  float sum = 0;  // of weights
};

ImageFormation::ImageFormation(const cv::Mat1f& inverse_depth, const FrameBlur& blur, float layer_gap)
    : inverse_depth_(inverse_depth), blur_(blur) {
  double least = 0, largest = 0;
  cv::minMaxLoc(inverse_depth, &least, &largest);
  least_ = static_cast<float>(least);
  per_layer_ = 1 / std::max(layer_gap, static_cast<float>((largest - least) / (kLayers - 1)));
}

void updateAll(std::vector<ImageFormation>& formation) {
  inParallel(static_cast<int>(formation.size()), [&](int k) { formation[k].update(); });
}

cv::Mat4f ImageFormation::withMargin(const cv::Mat3f& light) {
  cv::Mat4f four, wide;
  cv::cvtColor(light, four, cv::COLOR_BGR2BGRA);
  cv::copyMakeBorder(four, wide, kMargin, kMargin, kMargin, kMargin, cv::BORDER_REFLECT_101);
  return wide;
}

void ImageFormation::update() {
  const cv::Size size = inverse_depth_.size();
  cv::Mat1b index(size), layers(size), own(size);
  for (int y = 0; y < own.rows; ++y) {
    for (int x = 0; x < own.cols; ++x) {
      const Candidate here = candidate(inverse_depth_(y, x));
      index(y, x) = static_cast<std::uint8_t>(here.index);
      layers(y, x) = static_cast<std::uint8_t>(here.layer);
      own(y, x) = static_cast<std::uint8_t>(here.reach);
    }
  }
  cv::copyMakeBorder(index, index_, kMargin, kMargin, kMargin, kMargin, cv::BORDER_REFLECT_101);
  cv::copyMakeBorder(layers, layer_, kMargin, kMargin, kMargin, kMargin, cv::BORDER_REFLECT_101);
  reach_ = cv::Mat1b(size, std::uint8_t{0});
  nearest_ = layers.clone();
  cv::Mat as_wide, wide, nearest;
  for (size_t i = 1; i < kReaches.size(); ++i) {
    cv::compare(own, kReaches[i - 1], as_wide, cv::CMP_GT);
    if (cv::countNonZero(as_wide) == 0) break;
    const int side = 2 * (kReaches[i] + kMovedPx) + 1;
    const cv::Mat square = cv::getStructuringElement(cv::MORPH_RECT, {side, side});
    cv::dilate(as_wide, wide, square);
    reach_.setTo(kReaches[i], wide);
    cv::dilate(layers & as_wide & (own <= kReaches[i]), nearest, square);
    cv::max(nearest_, nearest, nearest_);
  }
}

void ImageFormation::update(const std::vector<cv::Point>& changed) {
  for (const cv::Point& p : changed) {
    const Candidate now = candidate(inverse_depth_(p));
    index_(p.y + kMargin, p.x + kMargin) = static_cast<std::uint8_t>(now.index);
    layer_(p.y + kMargin, p.x + kMargin) = static_cast<std::uint8_t>(now.layer);
  }
}

ImageFormation::Candidate ImageFormation::candidate(float inverse_depth) const {
  const int index = DiscKernels::index(blur_.radius(inverse_depth));
  return {index, layer(inverse_depth), DiscKernels::get().reach(index)};
}

// visit(dx, dy, share, layer) of every pixel but p itself, at most `half` away, whose disc covers p.
template <typename Visit>
void ImageFormation::forEachThatLightsUp(const cv::Point& p, int half, const Visit& visit) const {
  const DiscKernels& kernels = DiscKernels::get();
  const int count = 2 * half + 1;
  for (int dy = -half; dy <= half; ++dy) {
    const int v = std::abs(dy), left = p.x - half + kMargin;
    const std::uint8_t* indices = index_[p.y + dy + kMargin] + left;
    const std::uint8_t* layers = layer_[p.y + dy + kMargin] + left;
    const std::uint8_t* least = kernels.leastIndices(v) - half;
    for (int i = 0; i < count; i += kBlock) {
      unsigned bits = static_cast<unsigned>(cv::v_signmask(cv::v_load(indices + i) >= cv::v_load(least + i)));
      if (count - i < kBlock) bits &= (1u << (count - i)) - 1;
      if (dy == 0 && half - i >= 0 && half - i < kBlock) bits &= ~(1u << (half - i));
      for (; bits != 0; bits &= bits - 1) {
        const int at = i + __builtin_ctz(bits), dx = at - half;
        visit(dx, dy, kernels.shares(indices[at])[DiscKernels::kSide * v + std::abs(dx)], layers[at]);
      }
    }
  }
}

// Parts no farther than `half` away. Nearest layers come first, until the pixel has all its light.
void ImageFormation::gather(const cv::Point& p, const Candidate& own, int half, Lights& lights) const {
  int count = 0, nearest = own.layer;
  lights.factors.fill(0);
  const auto take = [&](int dx, int dy, float share, int l) {
    lights.dx[count] = static_cast<std::int8_t>(dx);
    lights.dy[count] = static_cast<std::int8_t>(dy);
    lights.shares[count] = share;
    lights.layers[count++] = static_cast<std::uint8_t>(l);
    lights.factors[l] += share;
    nearest = std::max(nearest, l);
  };
  take(0, 0, DiscKernels::get().shares(own.index)[0], own.layer);
  forEachThatLightsUp(p, half, take);
  lights.count = count;
  lights.total = 0;
  int l = nearest;
  for (; l >= 0 && lights.total < 1; --l) {
    if (lights.factors[l] == 0) continue;
    const float sum = lights.factors[l];
    lights.factors[l] = std::min((1 - lights.total) / sum, 1.0f);
    lights.total += lights.factors[l] * sum;
  }
  std::fill_n(lights.factors.begin(), l + 1, 0.0f);
}

// visit(dx, dy, share) of every part. What lies dx, dy away may be outside the picture. Returns the share of
// p's own disc.
template <typename Visit>
float ImageFormation::forEachPart(const cv::Point& p, float inverse_depth, const Visit& visit) const {
  const Candidate own = candidate(inverse_depth);
  // Where nothing nearer comes into it the own disc is enough, if it is filled.
  const bool is_on_top = nearest_(p) <= own.layer + 1;
  if (is_on_top && own.reach == 0) {
    visit(0, 0, 1);
    return 1;
  }
  const int farthest = std::max<int>(reach_(p), own.reach), half = is_on_top ? own.reach : farthest;
  Lights lights;
  gather(p, own, half, lights);
  if (lights.total < kWhole && half < farthest) gather(p, own, farthest, lights);
  Hidden hidden;
  if (lights.total < kWhole) hidden = hiddenAt(p, own.layer);
  const float scale = hidden.count > 0 ? 1 : 1 / lights.total;
  for (int i = 0; i < lights.count; ++i)
    visit(lights.dx[i], lights.dy[i], scale * lights.factors[lights.layers[i]] * lights.shares[i]);
  for (int i = 0; i < hidden.count; ++i) {
    visit(hidden.at[i] % kNearbySide - kNearby, hidden.at[i] / kNearbySide - kNearby,
          nearbyWeights()[hidden.at[i]] * (1 - lights.total) / hidden.sum);
  }
  return scale * lights.factors[own.layer] * lights.shares[0];
}

void ImageFormation::partsOf(const cv::Point& p, float inverse_depth, std::vector<Part>& parts) const {
  parts.clear();
  forEachPart(p, inverse_depth, [&](int dx, int dy, float share) {
    if (share == 0) return;
    const int x = mirrored(p.x + dx, inverse_depth_.cols), y = mirrored(p.y + dy, inverse_depth_.rows);
    parts.push_back({static_cast<std::int16_t>(x - p.x), static_cast<std::int16_t>(y - p.y), share});
  });
}

ImageFormation::Prediction ImageFormation::predict(const cv::Point& p, float inverse_depth,
                                                   const cv::Mat4f& sharp) const {
  const cv::Vec4f* here = &sharp(p.y + kMargin, p.x + kMargin);
  const auto stride = static_cast<std::ptrdiff_t>(sharp.step1() / 4);
  cv::Vec4f light;
  const float own_share = forEachPart(
      p, inverse_depth, [&](int dx, int dy, float share) { light += share * here[dy * stride + dx]; });
  return {{light[0], light[1], light[2]}, own_share};
}

// The share that no disc provides belongs to what is hidden: if something nearby covers p's own surface, to
// that surface; else to what lies behind p.
ImageFormation::Hidden ImageFormation::hiddenAt(const cv::Point& p, int own_layer) const {
  const int left = std::max(-kNearby, -p.x), right = std::min(kNearby, inverse_depth_.cols - 1 - p.x);
  const int top = std::max(-kNearby, -p.y), bottom = std::min(kNearby, inverse_depth_.rows - 1 - p.y);
  const unsigned inside = ((2u << (right + kNearby)) - 1) & ~((1u << (left + kNearby)) - 1);
  // bits(dy): of a row, which columns from -kNearby on are there and have a layer up to `most`.
  const auto bits = [&](int dy, int most) {
    const cv::v_uint8x16 row = cv::v_load(layer_[p.y + dy + kMargin] + p.x + kMargin - kNearby);
    const auto limit = cv::v_setall_u8(static_cast<std::uint8_t>(std::max(0, most)));
    return most < 0 ? 0 : static_cast<unsigned>(cv::v_signmask(row <= limit)) & inside;
  };
  constexpr unsigned kCentre = 1u << kNearby;
  bool covered = false;
  for (int dy = top; dy <= bottom && !covered; ++dy)
    covered = (bits(dy, own_layer + 1) | (dy == 0 ? kCentre : 0)) != inside;
  const int farther_than = covered ? own_layer + 2 : own_layer - 1;
  Hidden hidden;
  for (int dy = top; dy <= bottom; ++dy) {
    unsigned found = bits(dy, farther_than - 1);
    if (dy == 0) found = covered ? found | kCentre : found & ~kCentre;
    for (; found != 0; found &= found - 1) {
      const int at = kNearbySide * (dy + kNearby) + __builtin_ctz(found);
      hidden.at[hidden.count++] = at;
      hidden.sum += nearbyWeights()[at];
    }
  }
  return hidden;
}

}  // namespace all_in_focus::core
