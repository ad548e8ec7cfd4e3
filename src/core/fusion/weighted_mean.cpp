// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/weighted_mean.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core/utility.hpp>

#include "fusion/region_fusion.hpp"
#include "util/rounding.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

// Rounding to 8 bits is noise as well; below it nothing can be told.
constexpr double kRounding = 1;

// A gain from a frame below this share of the error's own noise is not worth the loss of a frame to average.
constexpr double kNoiseVariances = 4;

// Less sharp than this share of the sharpest frame is all the same: its eighth power, 1e-24, times any
// expected error must stay a normal number.
constexpr float kLeastShare = 1e-3f;

// Makes weights divisors where there is none, and disappears in all others.
constexpr float kNoWeight = std::numeric_limits<float>::min();

constexpr int kSpan = 512;  // pixels worked on at a time: what they need stays in the L1 cache

// What follows works on a span of one row, n <= kSpan pixels.

// weight: sharpness^8 in units of the sharpest frame's, this one included; keep: what remains of older sums
// in these units.
ALL_IN_FOCUS_SIMD void weighSharpness(const float* sharpness, int n, float* sharpest, float* keep,
                                      float* weight) {
  for (int i = 0; i < n; ++i) {
    const float less = std::min(sharpness[i], sharpest[i]), more = std::max(sharpness[i], sharpest[i]);
    const float share = std::max(less / more, kLeastShare);
    const float square = share * share, fourth = square * square, eighth = fourth * fourth;
    const bool sharper = sharpness[i] > sharpest[i];
    keep[i] = sharper ? eighth : 1;
    weight[i] = sharper ? 1 : eighth;
    sharpest[i] = more;
  }
}

ALL_IN_FOCUS_SIMD void weighError(const float* squared_error, float floor, int n, float* weight) {
  for (int i = 0; i < n; ++i) weight[i] /= squared_error[i] + floor;
}

// n: values, three a pixel
ALL_IN_FOCUS_SIMD void toFloat(const std::uint8_t* from, int n, float* to) {
  for (int i = 0; i < n; ++i) to[i] = from[i];
}

void decode(const std::uint8_t* from, const std::array<float, 256>& codes, int n, float* to) {
  for (int i = 0; i < n; ++i) to[i] = codes[from[i]];
}

ALL_IN_FOCUS_SIMD void threeTimes(const float* weight, int n, float* weights) {
  for (int i = 0; i < n; ++i) weights[3 * i] = weights[3 * i + 1] = weights[3 * i + 2] = weight[i];
}

ALL_IN_FOCUS_SIMD void addProducts(const float* keep, const float* weights, const float* values, int n,
                                   float* sum) {
  for (int i = 0; i < n; ++i) sum[i] = keep[i] * sum[i] + weights[i] * values[i];
}

ALL_IN_FOCUS_SIMD void addWeights(const float* keep, const float* weight, int n, float* sum) {
  for (int i = 0; i < n; ++i) sum[i] = keep[i] * sum[i] + weight[i];
}

ALL_IN_FOCUS_SIMD void scale(const float* factor, int n, float* values) {
  for (int i = 0; i < n; ++i) values[i] *= factor[i];
}

void copyHeavier(const float* weight, const float* most, const float* values, int n, float* chosen) {
  for (int i = 0; i < n; ++i) {
    if (weight[i] > most[i]) std::copy_n(values + 3 * i, 3, chosen + 3 * i);
  }
}

ALL_IN_FOCUS_SIMD void keepHeavier(const float* weight, std::uint16_t index, int n, float* most,
                                   std::uint16_t* source) {
  for (int i = 0; i < n; ++i) source[i] = weight[i] > most[i] ? index : source[i];
  for (int i = 0; i < n; ++i) most[i] = std::max(most[i], weight[i]);
}

ALL_IN_FOCUS_SIMD void invert(const float* weight, int n, float* inverse) {
  for (int i = 0; i < n; ++i) inverse[i] = 1 / (weight[i] + kNoWeight);
}

ALL_IN_FOCUS_SIMD void roundProducts(const float* a, const float* b, int n, std::uint8_t* __restrict out) {
  for (int i = 0; i < n; ++i) out[i] = roundToCode(a[i] * b[i]);
}

// 255 (1 - mean / greatest weight) frames / (frames - 1); 0 where there is none
ALL_IN_FOCUS_SIMD void rate(const float* weights, const float* most, float frames, int n,
                            std::uint8_t* __restrict out) {
  const float scale = 255 * frames / (frames - 1);
  for (int i = 0; i < n; ++i) {
    out[i] = roundToCode(scale * (most[i] - weights[i] / frames) / (most[i] + kNoWeight));
  }
}

bool areTheirOwnValues(const std::array<float, 256>& codes) {
  for (int code = 0; code < 256; ++code) {
    if (codes[code] != static_cast<float>(code)) return false;
  }
  return true;
}

}  // namespace

void WeightedMean::begin(const cv::Size& size, double noise, const Kind& kind) {
  soft_ = kind.soft;
  choice_ = kind.choice || !kind.soft;
  frames_ = 0;
  error_floor_ = static_cast<float>(kRounding + kNoiseVariances * noise * noise);
  colors_.create(size, CV_32FC3);
  colors_.setTo(0);
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

void WeightedMean::beginFrame(int index, const std::array<float, 256>& codes) {
  ++frames_;
  index_ = static_cast<std::uint16_t>(index);
  codes_ = codes;
  plain_ = areTheirOwnValues(codes);
}

void WeightedMean::addRow(int y, const cv::Range& columns, const std::uint8_t* pixels,
                          const EvidenceRow& evidence) {
  for (int x = columns.start; x < columns.end; x += kSpan) {
    const int n = std::min(kSpan, columns.end - x);
    std::array<float, kSpan> keep, weight;
    std::array<float, 3 * kSpan> values;
    weighSharpness(evidence.sharpness + x, n, sharpest_.ptr<float>(y) + x, keep.data(), weight.data());
    if (evidence.squared_error) weighError(evidence.squared_error + x, error_floor_, n, weight.data());
    if (plain_) {
      toFloat(pixels + 3 * x, 3 * n, values.data());
    } else {
      decode(pixels + 3 * x, codes_, 3 * n, values.data());
    }
    accumulate(keep.data(), weight.data(), values.data(), {x, y}, n);
  }
}

void WeightedMean::accumulate(const float* keep, const float* weight, const float* values,
                              const cv::Point& at, int n) {
  float* color = colors_.ptr<float>(at.y) + 3 * at.x;
  float* most = choice_ ? most_.ptr<float>(at.y) + at.x : nullptr;
  if (choice_) scale(keep, n, most);
  if (soft_) {
    std::array<float, 3 * kSpan> keeps, weights;
    threeTimes(keep, n, keeps.data());
    threeTimes(weight, n, weights.data());
    addProducts(keeps.data(), weights.data(), values, 3 * n, color);
  } else {
    copyHeavier(weight, most, values, n, color);
  }
  addWeights(keep, weight, n, weights_.ptr<float>(at.y) + at.x);
  if (choice_) keepHeavier(weight, index_, n, most, source_index_.ptr<std::uint16_t>(at.y) + at.x);
}

cv::Mat WeightedMean::image() const {
  cv::Mat image(colors_.size(), CV_8UC3);
  cv::parallel_for_(cv::Range(0, image.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < image.cols; x += kSpan) {
        const int n = std::min(kSpan, image.cols - x);
        std::array<float, kSpan> scale;
        std::array<float, 3 * kSpan> scales;
        scale.fill(1);
        if (soft_) invert(weights_.ptr<float>(y) + x, n, scale.data());
        threeTimes(scale.data(), n, scales.data());
        roundProducts(colors_.ptr<float>(y) + 3 * x, scales.data(), 3 * n, image.ptr(y) + 3 * x);
      }
    }
  });
  return image;
}

cv::Mat WeightedMean::confidence() const {
  cv::Mat confidence(weights_.size(), CV_8UC1, cv::Scalar(255));
  if (frames_ < 2) return confidence;
  cv::parallel_for_(cv::Range(0, confidence.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      rate(weights_.ptr<float>(y), most_.ptr<float>(y), static_cast<float>(frames_), confidence.cols,
           confidence.ptr(y));
    }
  });
  return confidence;
}

}  // namespace all_in_focus::core
