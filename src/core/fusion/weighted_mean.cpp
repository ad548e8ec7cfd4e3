// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/weighted_mean.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "all_in_focus/codes.hpp"
#include "all_in_focus/fusion.hpp"
#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr struct MeanParameters {
  double rounding = 1.0 / 12;  // variance of rounding to 8 bits, which is noise, too
  // Floor of the expected error, in variances of the noise: where errors are smaller, more frames in the mean
  // are worth more than better ones. (1: slope_24mm +0.5 dB, plain_noise2 -0.5.)
  double noise_variances = 5;
  // Contrast of fine detail, gray levels. A frame that is less sharp by a share d errs by about d times that.
  // Where its error is the deviation of the noise, it gives as much as it takes, and weighs half:
  // (1 - d)^power = 1/2.
  double detail = 5;
  // The errors of resampling look like detail: a share r near 1 of the sharpness tells little. Of brackets
  // with resampled frames r^8 (1 - flat + flat r^4) takes the place of r^8, at r = 1 a power of 5. (Against
  // 0: 56 scenes, half of them without such frames, +0.03 dB, least -0.04; -0.5 gains less, -1 loses 0.06.)
  float flat = -0.75f;
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

constexpr int kSpan = 512;  // pixels worked on at a time: what they need stays in the L1 cache

// What follows works on a span of one row, n <= kSpan pixels.

// Adds the weight of a frame to what remains of the sum of weights.
// weight: the power of the sharpness in units of the sharpest frame's, this one included, over the expected
// error; keep: what remains of older sums in these units; before: the sum without the frame; share: of the
// weight in the new sum.
ALL_IN_FOCUS_SIMD void addWeights(const float* sharpness, const float* squared_error, float floor,
                                  float steep, int n, float* __restrict sharpest, float* __restrict sum,
                                  float* __restrict keep, float* __restrict weight, float* __restrict before,
                                  float* __restrict share) {
  for (int i = 0; i < n; ++i) {
    const float less = std::min(sharpness[i], sharpest[i]), more = std::max(sharpness[i], sharpest[i]);
    const float ratio = std::max(less / more, kMean.least_share);
    const float square = ratio * ratio, fourth = square * square;
    const float power = fourth * fourth * (1 - steep + steep * fourth);
    const bool sharper = sharpness[i] > sharpest[i];
    keep[i] = sharper ? power : 1;
    weight[i] = (sharper ? 1 : power) / (squared_error[i] + floor);
    sharpest[i] = more;
    before[i] = keep[i] * sum[i];
    sum[i] = before[i] + weight[i];
    share[i] = weight[i] / (sum[i] + kNoWeight);
  }
}

// Of frames of which a part counts. The first frame there, before = 0, has nothing to fade into. sum: with
// the frame, then as much as later frames are to be compared with.
void fade(const float* part, const float* before, int n, float* sum, float* share) {
  constexpr float kLeast = 1e-8f;
  constexpr int kPiece = 64;  // most are whole
  for (int begin = 0; begin < n; begin += kPiece) {
    const int end = std::min(begin + kPiece, n);
    if (part[begin] == 1 && part[end - 1] == 1) continue;  // so are all between, for parts rise, then fall
    for (int i = begin; i < end; ++i) {
      if (part[i] == 1) continue;
      if (before[i] > 0) share[i] *= part[i];
      sum[i] *= std::pow(std::max(before[i] / (sum[i] + kNoWeight), kLeast), 1 - part[i]);
    }
  }
}

constexpr std::uint16_t kAll = 65535;  // a share of 1

ALL_IN_FOCUS_SIMD void threeTimes(const float* shares, int n, std::uint16_t* __restrict out) {
  for (int i = 0; i < n; ++i)
    out[3 * i] = out[3 * i + 1] = out[3 * i + 2] =
        static_cast<std::uint16_t>(static_cast<int>(kAll * shares[i] + 0.5f));
}

inline std::uint16_t product(std::uint16_t code, std::uint16_t share) {
  return static_cast<std::uint16_t>((std::uint32_t{code} * share) >> 16);
}

// Moves the mean towards the codes by their shares. unit: of a code, in codes of 16 bits. Both products lose
// half a unit on average, so the mean neither grows nor falls by it.
template <typename Code>
inline void move(const Code* codes, std::uint16_t unit, const std::uint16_t* shares, int n,
                 std::uint16_t* __restrict mean) {
  for (int i = 0; i < n; ++i) {
    const std::uint16_t share = shares[i], now = mean[i];
    const auto code = static_cast<std::uint16_t>(unit * codes[i]);
    const auto moved = static_cast<std::uint16_t>(now - product(now, share) + product(code, share));
    mean[i] = share == kAll ? code : moved;
  }
}

ALL_IN_FOCUS_SIMD void moveTowards(const std::uint8_t* codes, const std::uint16_t* shares, int n,
                                   std::uint16_t* __restrict mean) {
  move(codes, static_cast<std::uint16_t>(kDeepPerCode), shares, n, mean);
}

ALL_IN_FOCUS_SIMD void moveTowards(const std::uint16_t* codes, const std::uint16_t* shares, int n,
                                   std::uint16_t* __restrict mean) {
  move(codes, 1, shares, n, mean);
}

// lut: see WeightedMean::beginFrame().
template <typename Code>
void moveTowards(const Code* codes, const std::vector<std::uint16_t>& lut, const std::uint16_t* shares, int n,
                 std::uint16_t* mean) {
  if (lut.empty()) return moveTowards(codes, shares, n, mean);
  std::array<std::uint16_t, 3 * kSpan> values;
  for (int i = 0; i < n; ++i) values[i] = lut[codes[i]];
  moveTowards(values.data(), shares, n, mean);
}

ALL_IN_FOCUS_SIMD void keepHeavier(const float* keep, const float* weight, std::uint16_t index, int n,
                                   float* most, std::uint16_t* source) {
  for (int i = 0; i < n; ++i) source[i] = weight[i] > keep[i] * most[i] ? index : source[i];
  for (int i = 0; i < n; ++i) most[i] = std::max(keep[i] * most[i], weight[i]);
}

}  // namespace

std::vector<float> fadeAlong(const cv::Range& seen, int size) {
  constexpr double kWidth = 0.5;  // over what the frame lacks
  const auto part = [](int distance, int lacks) {
    return std::min(1.0, (distance + 0.5) / (kWidth * lacks));
  };
  std::vector<float> parts(static_cast<std::size_t>(size), 1);
  for (int i = seen.start; i < seen.end; ++i) {
    parts[static_cast<std::size_t>(i)] =
        static_cast<float>(part(i - seen.start, seen.start) * part(seen.end - 1 - i, size - seen.end));
  }
  return parts;
}

void WeightedMean::begin(const cv::Size& size, double noise, const Kind& kind) {
  soft_ = kind.soft;
  choice_ = kind.choice || !kind.soft;
  frames_ = 0;
  steep_ = kind.resampled ? kMean.flat : kind.steep ? steepnessOf(noise) : 0;
  error_floor_ = static_cast<float>(kMean.rounding + kMean.noise_variances * noise * noise);
  mean_.create(size, CV_16UC3);
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

void WeightedMean::beginFrame(int index, std::vector<std::uint16_t> lut) {
  ++frames_;
  index_ = static_cast<std::uint16_t>(index);
  lut_ = std::move(lut);
}

void WeightedMean::addRow(int y, const cv::Range& columns, const cv::Mat& frame,
                          const EvidenceRow& evidence) {
  static constexpr std::array<float, kSpan> kNoError{};
  for (int x = columns.start; x < columns.end; x += kSpan) {
    const int n = std::min(kSpan, columns.end - x);
    std::array<float, kSpan> keep, weight, before, share;
    float* sum = weights_.ptr<float>(y) + x;
    addWeights(evidence.sharpness + x, evidence.squared_error ? evidence.squared_error + x : kNoError.data(),
               error_floor_, steep_, n, sharpest_.ptr<float>(y) + x, sum, keep.data(), weight.data(),
               before.data(), share.data());
    if (evidence.part) fade(evidence.part + x, before.data(), n, sum, share.data());
    if (choice_) {
      auto* source = source_index_.ptr<std::uint16_t>(y) + x;
      keepHeavier(keep.data(), weight.data(), index_, n, most_.ptr<float>(y) + x, source);
      for (int i = 0; i < n && !soft_; ++i) share[i] = source[i] == index_ ? 1 : 0;
    }
    std::array<std::uint16_t, 3 * kSpan> shares;
    threeTimes(share.data(), n, shares.data());
    auto* mean = mean_.ptr<std::uint16_t>(y) + 3 * x;
    if (frame.depth() == CV_16U) {
      moveTowards(frame.ptr<std::uint16_t>(y) + 3 * x, lut_, shares.data(), 3 * n, mean);
    } else {
      moveTowards(frame.ptr<std::uint8_t>(y) + 3 * x, lut_, shares.data(), 3 * n, mean);
    }
  }
}

cv::Mat WeightedMean::image(int depth) const {
  cv::Mat image;
  mean_.convertTo(image, depth, depth == CV_8U ? 1 / kDeepPerCode : 1);
  return image;
}

cv::Mat WeightedMean::confidence() const {
  cv::Mat confidence(weights_.size(), CV_8UC1, cv::Scalar(255));
  if (frames_ < 2) return confidence;
  const double frames = frames_;
  forEachBlock({0, confidence.rows}, [&](const cv::Range& rows) {
    const cv::Mat most = most_.rowRange(rows);
    cv::Mat block = confidence.rowRange(rows);
    cv::divide(most - weights_.rowRange(rows) / frames, most + kNoWeight, block, 255 * frames / (frames - 1),
               CV_8U);
  });
  return confidence;
}

}  // namespace all_in_focus::core
