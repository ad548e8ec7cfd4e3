// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/weighted_mean.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "all_in_focus/fusion.hpp"
#include "util/image_rows.hpp"
#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

// cv::saturate_cast<std::uint8_t>(value), which rounds half to even, in a form that compilers vectorise.
// |value| < 2^22.
inline std::uint8_t roundToCode(float value) {
  constexpr float kInteger = 3 << 22;  // floats near it have no fraction, so that adding it rounds
  const int code = static_cast<int>((value + kInteger) - kInteger);
  return static_cast<std::uint8_t>(std::min(std::max(code, 0), 255));
}

constexpr struct MeanParameters {
  double rounding = 1.0 / 12;  // variance of rounding to 8 bits, which is noise, too
  // Floor of the expected error, in variances of the noise: where errors are smaller, more frames in the mean
  // are worth more than better ones. (1: slope_24mm +0.5 dB, plain_noise2 -0.5.)
  double noise_variances = 5;
  // Contrast of fine detail, gray levels. A frame that is less sharp by a share d errs by about d times that.
  // Where its error is the deviation of the noise, it gives as much as it takes, and weighs half:
  // (1 - d)^power = 1/2.
  double detail = 5;
  // Least share of the sharpest frame's sharpness that a frame counts with. Its twelfth power, 1e-36, must
  // stay a normal number, and so must its eighth when an expected error divides it.
  float least_share = 1e-3f;
} kMean{};

// How far from power 8 to power 12, 0..1. Power 12 is that of rounding alone. (6 to 12 in place of 8 changes
// less than 0.2 dB.)
float steepnessOf(double noise) {
  const double power = kMean.detail * std::log(2.0) / std::sqrt(kMean.rounding + noise * noise);
  return static_cast<float>(std::clamp((power - 8) / 4, 0.0, 1.0));
}

// Added to divisors. Avoids a division by 0 and changes no other weight.
constexpr float kNoWeight = std::numeric_limits<float>::min();

constexpr int kUnit = 128;  // of a gray level in the mean: 15 bits

constexpr int kSpan = 512;  // pixels worked on at a time: what they need stays in the L1 cache

// What follows works on a span of one row, n <= kSpan pixels.

// weight: the power of the sharpness in units of the sharpest frame's, this one included; keep: what remains
// of older sums in these units.
ALL_IN_FOCUS_SIMD void weighSharpness(const float* sharpness, float steep, int n, float* sharpest,
                                      float* keep, float* weight) {
  for (int i = 0; i < n; ++i) {
    const float less = std::min(sharpness[i], sharpest[i]), more = std::max(sharpness[i], sharpest[i]);
    const float share = std::max(less / more, kMean.least_share);
    const float square = share * share, fourth = square * square;
    const float power = fourth * fourth * (1 - steep + steep * fourth);
    const bool sharper = sharpness[i] > sharpest[i];
    keep[i] = sharper ? power : 1;
    weight[i] = sharper ? 1 : power;
    sharpest[i] = more;
  }
}

ALL_IN_FOCUS_SIMD void weighError(const float* squared_error, float floor, int n, float* weight) {
  for (int i = 0; i < n; ++i) weight[i] /= squared_error[i] + floor;
}

// Adds the weight to what remains of the sum. share: of the weight in the new sum.
ALL_IN_FOCUS_SIMD void addWeights(const float* keep, const float* weight, int n, float* sum, float* share) {
  for (int i = 0; i < n; ++i) {
    sum[i] = keep[i] * sum[i] + weight[i];
    share[i] = weight[i] / (sum[i] + kNoWeight);
  }
}

// Of frames of which a part counts. before: the sum without the frame, 0: the first frame there has nothing
// to fade into; sum: with the frame, then as much as later frames are to be compared with.
void fade(const float* part, const float* before, int n, float* sum, float* share) {
  constexpr float kLeast = 1e-8f;
  for (int i = 0; i < n; ++i) {
    if (part[i] == 1) continue;
    if (before[i] > 0) share[i] *= part[i];
    sum[i] *= std::pow(std::max(before[i] / (sum[i] + kNoWeight), kLeast), 1 - part[i]);
  }
}

// Shares 0..1 in 16 bits, times -2^15: with that sign 1 has a number, too.
ALL_IN_FOCUS_SIMD void toFixedPoint(const float* share, int n, std::int16_t* __restrict fixed) {
  for (int i = 0; i < n; ++i)
    fixed[i] = static_cast<std::int16_t>(-static_cast<int>(share[i] * 32768 + 0.5f));
}

// Moves the mean towards the values by their shares (toFixedPoint()). n: of values, three a pixel; unit: what
// a value of 1 is in the mean.
template <typename Value>
inline void moveBy(const Value* values, int unit, const std::int16_t* shares, int n,
                   std::int16_t* __restrict mean) {
  for (int i = 0; i < n; ++i) {
    const auto way = static_cast<std::int16_t>(unit * values[i] - mean[i]);
    const auto step =
        static_cast<std::int16_t>(((way * shares[i] >> 14) + 1) >> 1);  // one instruction in AVX2
    mean[i] = static_cast<std::int16_t>(mean[i] - step);
  }
}

ALL_IN_FOCUS_SIMD void moveTowardsCodes(const std::uint8_t* codes, const std::int16_t* shares, int n,
                                        std::int16_t* __restrict mean) {
  moveBy(codes, kUnit, shares, n, mean);
}

ALL_IN_FOCUS_SIMD void moveTowards(const std::int16_t* values, const std::int16_t* shares, int n,
                                   std::int16_t* __restrict mean) {
  moveBy(values, 1, shares, n, mean);
}

void decode(const std::uint8_t* codes, const std::array<std::int16_t, 256>& lut, int n,
            std::int16_t* values) {
  for (int i = 0; i < n; ++i) values[i] = lut[codes[i]];
}

ALL_IN_FOCUS_SIMD void scale(const float* factor, int n, float* values) {
  for (int i = 0; i < n; ++i) values[i] *= factor[i];
}

// 1 where the frame weighs more than all before, else 0
ALL_IN_FOCUS_SIMD void choose(const float* weight, const float* most, int n, float* __restrict share) {
  for (int i = 0; i < n; ++i) share[i] = weight[i] > most[i] ? 1.0f : 0.0f;
}

ALL_IN_FOCUS_SIMD void keepHeavier(const float* weight, std::uint16_t index, int n, float* most,
                                   std::uint16_t* source) {
  for (int i = 0; i < n; ++i) source[i] = weight[i] > most[i] ? index : source[i];
  for (int i = 0; i < n; ++i) most[i] = std::max(most[i], weight[i]);
}

ALL_IN_FOCUS_SIMD void toCodes(const std::int16_t* mean, int n, std::uint8_t* __restrict codes) {
  for (int i = 0; i < n; ++i) codes[i] = static_cast<std::uint8_t>((mean[i] + kUnit / 2) / kUnit);
}

// 255 (1 - mean / greatest weight) frames / (frames - 1); 0 where there is none
ALL_IN_FOCUS_SIMD void rate(const float* weights, const float* most, float frames, int n,
                            std::uint8_t* __restrict out) {
  const float scale = 255 * frames / (frames - 1);
  for (int i = 0; i < n; ++i) {
    out[i] = roundToCode(scale * (most[i] - weights[i] / frames) / (most[i] + kNoWeight));
  }
}

}  // namespace

void WeightedMean::begin(const cv::Size& size, double noise, const Kind& kind) {
  soft_ = kind.soft;
  choice_ = kind.choice || !kind.soft;
  frames_ = 0;
  steep_ = kind.steep ? steepnessOf(noise) : 0;
  error_floor_ = static_cast<float>(kMean.rounding + kMean.noise_variances * noise * noise);
  mean_.create(size, kind.deep ? CV_32FC3 : CV_16SC3);
  mean_.setTo(0);
  sharpest_.create(size, CV_32FC1);
  sharpest_.setTo(0);
  weights_.create(size, CV_32FC1);
  weights_.setTo(0);
  if (!choice_) return;
  most_.create(size, CV_32FC1);
  most_.setTo(0);
  source_index_.create(size, CV_16UC1);
  source_index_.setTo(kNoFrame);
}

void WeightedMean::beginFrame(int index, const std::array<float, 256>& lut) {
  ++frames_;
  index_ = static_cast<std::uint16_t>(index);
  plain_ = true;
  for (int code = 0; code < 256; ++code) {
    lut_[code] = static_cast<std::int16_t>(std::lround(kUnit * std::clamp(lut[code], 0.0f, 255.0f)));
    plain_ = plain_ && lut_[code] == kUnit * code;
  }
}

void WeightedMean::beginFrame(int index, std::vector<float> lut) {
  ++frames_;
  index_ = static_cast<std::uint16_t>(index);
  deep_lut_ = std::move(lut);
}

void WeightedMean::addRow(int y, const cv::Range& columns, const std::uint8_t* pixels,
                          const EvidenceRow& evidence) {
  addCodes(y, columns, pixels, evidence);
}

void WeightedMean::addRow(int y, const cv::Range& columns, const std::uint16_t* pixels,
                          const EvidenceRow& evidence) {
  addCodes(y, columns, pixels, evidence);
}

template <typename Code>
void WeightedMean::addCodes(int y, const cv::Range& columns, const Code* pixels,
                            const EvidenceRow& evidence) {
  for (int x = columns.start; x < columns.end; x += kSpan) {
    const int n = std::min(kSpan, columns.end - x);
    std::array<float, kSpan> keep, weight, share;
    weighSharpness(evidence.sharpness + x, steep_, n, sharpest_.ptr<float>(y) + x, keep.data(),
                   weight.data());
    if (evidence.squared_error) weighError(evidence.squared_error + x, error_floor_, n, weight.data());
    chooseShares(keep.data(), weight.data(), {x, y}, n, evidence.part ? evidence.part + x : nullptr,
                 share.data());
    move(share.data(), pixels + 3 * x, {x, y}, n);
  }
}

void WeightedMean::chooseShares(const float* keep, const float* weight, const cv::Point& at, int n,
                                const float* part, float* share) {
  float* sum = weights_.ptr<float>(at.y) + at.x;
  std::array<float, kSpan> before;
  if (part) std::transform(sum, sum + n, keep, before.begin(), std::multiplies<>());
  addWeights(keep, weight, n, sum, share);
  if (part) fade(part, before.data(), n, sum, share);
  if (!choice_) return;
  float* most = most_.ptr<float>(at.y) + at.x;
  scale(keep, n, most);
  if (!soft_) choose(weight, most, n, share);
  keepHeavier(weight, index_, n, most, source_index_.ptr<std::uint16_t>(at.y) + at.x);
}

void WeightedMean::move(const float* share, const std::uint8_t* pixels, const cv::Point& at, int n) {
  std::array<std::int16_t, kSpan> fixed;
  std::array<std::int16_t, 3 * kSpan> shares;
  toFixedPoint(share, n, fixed.data());
  threeTimes(fixed.data(), n, shares.data());
  auto* mean = mean_.ptr<std::int16_t>(at.y) + 3 * at.x;
  if (plain_) return moveTowardsCodes(pixels, shares.data(), 3 * n, mean);
  std::array<std::int16_t, 3 * kSpan> values;
  decode(pixels, lut_, 3 * n, values.data());
  moveTowards(values.data(), shares.data(), 3 * n, mean);
}

void WeightedMean::move(const float* share, const std::uint16_t* pixels, const cv::Point& at, int n) {
  auto* mean = mean_.ptr<float>(at.y) + 3 * at.x;
  for (int i = 0; i < 3 * n; ++i) mean[i] += share[i / 3] * (deep_lut_[pixels[i]] - mean[i]);
}

cv::Mat WeightedMean::image() const {
  if (mean_.depth() == CV_32F) {
    cv::Mat image;
    mean_.convertTo(image, CV_16U);
    return image;
  }
  cv::Mat image(mean_.size(), CV_8UC3);
  forEachRow(image.rows, [&](int y) { toCodes(mean_.ptr<std::int16_t>(y), 3 * image.cols, image.ptr(y)); });
  return image;
}

cv::Mat WeightedMean::confidence() const {
  cv::Mat confidence(weights_.size(), CV_8UC1, cv::Scalar(255));
  if (frames_ < 2) return confidence;
  forEachRow(confidence.rows, [&](int y) {
    rate(weights_.ptr<float>(y), most_.ptr<float>(y), static_cast<float>(frames_), confidence.cols,
         confidence.ptr(y));
  });
  return confidence;
}

}  // namespace all_in_focus::core
