// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/image_formation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/imgproc.hpp>

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
  return cv::borderInterpolate(i, size, cv::BORDER_REFLECT_101);
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

// Shares and light of what lights up a pixel, but that pixel itself, by layer.
struct ImageFormation::Layers {
  std::uint64_t present = 0;
  std::array<std::array<float, 4>, kLayers> sums;  // light and, last, share; of layers present
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
  cv::parallel_for_({0, static_cast<int>(formation.size())}, [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k) formation[k].update();
  });
}

cv::Mat4f ImageFormation::withMargin(const cv::Mat3f& light) {
  cv::Mat4f four, wide;
  cv::cvtColor(light, four,
               cv::COLOR_BGR2BGRA);  // its last channel is 1: what is summed up there is the share
  cv::copyMakeBorder(four, wide, kMargin, kMargin, kMargin, kMargin, cv::BORDER_REFLECT_101);
  return wide;
}

void ImageFormation::update() {
  const DiscKernels& kernels = DiscKernels::get();
  const cv::Size size = inverse_depth_.size();
  cv::Mat1b index(size), layers(size), own(size);
  for (int y = 0; y < own.rows; ++y) {
    for (int x = 0; x < own.cols; ++x) {
      index(y, x) = static_cast<std::uint8_t>(DiscKernels::index(blur_.radius(inverse_depth_(y, x))));
      layers(y, x) = static_cast<std::uint8_t>(layer(inverse_depth_(y, x)));
      own(y, x) = static_cast<std::uint8_t>(kernels.reach(index(y, x)));
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

// Nothing that may light up p is nearer than its own surface.
bool ImageFormation::isOnTop(const cv::Point& p, const Candidate& own) const {
  return nearest_(p) <= own.layer + 1;
}

void ImageFormation::partsOf(const cv::Point& p, float inverse_depth, std::vector<Part>& parts) const {
  const Candidate own = candidate(inverse_depth);
  // Where nothing nearer comes into it the own disc is enough, if it is filled.
  if (isOnTop(p, own)) {
    if (own.reach == 0) {
      parts.assign(1, {0, 0, 1});
      return;
    }
    if (gather(p, own, own.reach, parts) >= kWhole) return;
  }
  const float total = gather(p, own, std::max<int>(reach_(p), own.reach), parts);
  if (total >= kWhole) return;
  const Hidden hidden = hiddenAt(p, own.layer);
  if (hidden.count == 0) {
    for (Part& part : parts) part.share /= total;
  }
  for (int i = 0; i < hidden.count; ++i) {
    parts.push_back({static_cast<std::int16_t>(hidden.at[i] % kNearbySide - kNearby),
                     static_cast<std::int16_t>(hidden.at[i] / kNearbySide - kNearby),
                     nearbyWeights()[hidden.at[i]] * (1 - total) / hidden.sum});
  }
}

// Parts no farther than `half` away; returns the sum of their shares, which is 1 if it is nearly 1.
float ImageFormation::gather(const cv::Point& p, const Candidate& own, int half,
                             std::vector<Part>& parts) const {
  std::array<float, kLayers> sums;
  std::uint64_t present = 0;
  std::array<Part, kMostParts> found;  // member by member: a Part made elsewhere and copied takes longer
  std::array<std::uint8_t, kMostParts> layers;
  int count = 0;
  const auto take = [&](int dx, int dy, float share, int l) {
    if (!(present >> l & 1)) sums[l] = 0;
    present |= std::uint64_t{1} << l;
    sums[l] += share;
    found[count].dx = static_cast<std::int16_t>(dx);
    found[count].dy = static_cast<std::int16_t>(dy);
    found[count].share = share;
    layers[count++] = static_cast<std::uint8_t>(l);
  };
  take(0, 0, DiscKernels::get().shares(own.index)[0], own.layer);
  forEachThatLightsUp(p, half, take);
  // Nearest layers first, until the pixel has all its light.
  std::array<float, kLayers> factors;
  float total = 0;
  for (; present != 0; present &= ~(std::uint64_t{1} << (63 - __builtin_clzll(present)))) {
    const int l = 63 - __builtin_clzll(present);
    factors[l] = std::clamp((1 - total) / sums[l], 0.0f, 1.0f);
    total += factors[l] * sums[l];
  }
  const float scale = total >= kWhole ? 1 / total : 1;
  const bool inside =
      cv::Rect(half, half, inverse_depth_.cols - 2 * half, inverse_depth_.rows - 2 * half).contains(p);
  parts.resize(count);
  Part* to = parts.data();
  for (int i = 0; i < count; ++i) {
    const Part& part = found[i];
    const float share = part.share * factors[layers[i]] * scale;
    if (share <= 0) continue;
    to->dx = inside ? part.dx : static_cast<std::int16_t>(mirrored(p.x + part.dx, inverse_depth_.cols) - p.x);
    to->dy = inside ? part.dy : static_cast<std::int16_t>(mirrored(p.y + part.dy, inverse_depth_.rows) - p.y);
    to->share = share;
    ++to;
  }
  parts.resize(to - parts.data());
  return total;
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

void ImageFormation::collect(const cv::Point& p, int half, const cv::Mat4f& sharp, Layers& layers) const {
  layers.present = 0;
  const cv::Vec4f* centre = &sharp(p.y + kMargin, p.x + kMargin);
  const auto stride = static_cast<std::ptrdiff_t>(sharp.step1() / 4);
  forEachThatLightsUp(p, half, [&](int dx, int dy, float share, int l) {
    float* sum = layers.sums[l].data();
    const cv::v_float32x4 more = cv::v_load(centre[dy * stride + dx].val) * cv::v_setall_f32(share);
    if (layers.present >> l & 1) {
      cv::v_store(sum, cv::v_load(sum) + more);
    } else {
      layers.present |= std::uint64_t{1} << l;
      cv::v_store(sum, more);
    }
  });
}

template <std::size_t N>
void ImageFormation::predict(const cv::Point& p, const float (&own)[N], const cv::Mat4f& sharp,
                             Prediction (&predictions)[N]) const {
  Candidate candidates[N];
  int half = reach_(p);
  for (std::size_t i = 0; i < N; ++i) {
    candidates[i] = candidate(own[i]);
    half = std::max(half, candidates[i].reach);
  }
  const cv::Vec4f& here = sharp(p.y + kMargin, p.x + kMargin);
  // Light and share of all parts, and the share of p itself; as in gather().
  const auto mixed = [&](const Candidate& one, const Layers& layers, float& own_share) {
    const float own_light = DiscKernels::get().shares(one.index)[0];
    cv::Vec4f sum;
    std::uint64_t left = layers.present | std::uint64_t{1} << one.layer;
    for (; left != 0 && sum[3] < 1; left &= ~(std::uint64_t{1} << (63 - __builtin_clzll(left)))) {
      const int l = 63 - __builtin_clzll(left);
      cv::Vec4f of_layer;
      if (layers.present >> l & 1) of_layer = cv::Vec4f(layers.sums[l].data());
      if (l == one.layer) of_layer += own_light * here;
      const float taken = std::min((1 - sum[3]) / of_layer[3], 1.0f);
      sum += taken * of_layer;
      if (l == one.layer) own_share = taken * own_light;
    }
    return sum;
  };
  Layers near, all;
  bool has_all = false;
  for (std::size_t i = 0; i < N; ++i) {
    const Candidate& one = candidates[i];
    cv::Vec4f sum;
    float own_share = 0;
    if (isOnTop(p, one)) {
      if (one.reach == 0) {
        predictions[i] = {{here[0], here[1], here[2]}, 1};
        continue;
      }
      collect(p, one.reach, sharp, near);
      sum = mixed(one, near, own_share);
    }
    if (sum[3] < kWhole) {
      if (!has_all) collect(p, half, sharp, all);
      has_all = true;
      own_share = 0;
      sum = mixed(one, all, own_share);
    }
    if (sum[3] < kWhole) {
      const Hidden hidden = hiddenAt(p, one.layer);
      cv::Vec4f behind;
      for (int k = 0; k < hidden.count; ++k) {
        behind += nearbyWeights()[hidden.at[k]] * sharp(p.y + hidden.at[k] / kNearbySide - kNearby + kMargin,
                                                        p.x + hidden.at[k] % kNearbySide - kNearby + kMargin);
      }
      if (hidden.count > 0) sum += (1 - sum[3]) / hidden.sum * behind;
    }
    predictions[i] = {cv::Vec3f(sum[0], sum[1], sum[2]) / sum[3], own_share / sum[3]};
  }
}

template void ImageFormation::predict(const cv::Point&, const float (&)[1], const cv::Mat4f&,
                                      Prediction (&)[1]) const;
template void ImageFormation::predict(const cv::Point&, const float (&)[2], const cv::Mat4f&,
                                      Prediction (&)[2]) const;

}  // namespace all_in_focus::core
