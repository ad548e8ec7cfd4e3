// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/reference_warp.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "util/image_rows.hpp"
#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kTaps = 6;
constexpr int kChannels = 3;
constexpr int kBorder = 3 + kTaps;  // pixels that taps may lie beyond a border
constexpr int kSteps = 2048;        // of a pixel: positions are rounded to these

// Fixed point. A product keeps the upper 16 of its 32 bits, so gray levels lose a bit with each pass. Six
// products cut off three units on average, which kCutOff gives back.
constexpr int kOne = 1 << 15;       // of weights
constexpr int kLargest = kOne - 1;  // weight, instead of 1
constexpr int kInputBits = 7;       // behind the point of a gray level
constexpr int kOutputBits = 5;      // after two passes
constexpr int kCutOff = kTaps / 2;  // units

using Weights = std::array<std::int16_t, kTaps>;

// The kernel sinc(x) sinc(x / 3) at x = fraction + 2, + 1, ... - 3, by steps of the fraction. The third
// weight is what the others leave of 1: flat places keep their level.
const std::array<Weights, kSteps + 1>& lanczos() {
  static const auto table = [] {
    const auto sinc = [](double x) { return x == 0 ? 1 : std::sin(CV_PI * x) / (CV_PI * x); };
    std::array<Weights, kSteps + 1> weights;
    for (int i = 0; i <= kSteps; ++i) {
      std::array<double, kTaps> kernel;
      double sum = 0;
      for (int k = 0; k < kTaps; ++k) {
        const double x = static_cast<double>(i) / kSteps + 2 - k;
        sum += kernel[k] = sinc(x) * sinc(x / 3);
      }
      int left = kOne;
      for (const int k : {0, 1, 3, 4, 5, 2}) {
        const int weight = k == 2 ? left : cvRound(kOne * kernel[k] / sum);
        weights[i][k] = static_cast<std::int16_t>(std::min(weight, kLargest));
        left -= weight;
      }
    }
    return weights;
  }();
  return table;
}

inline int product(std::int16_t value, std::int16_t weight) {
  return (value * weight) >> 16;
}

ALL_IN_FOCUS_SIMD void toFixedPoint(const std::uint8_t* from, int n, std::int16_t* __restrict to) {
  for (int i = 0; i < n; ++i) to[i] = static_cast<std::int16_t>(from[i] << kInputBits);
}

// Every value has weights of its own: w[i], w[stride + i], ...
ALL_IN_FOCUS_SIMD void combineAlong(const std::int16_t* from, const std::int16_t* w, size_t stride, int n,
                                    std::int16_t* __restrict to) {
  for (int i = 0; i < n; ++i) {
    to[i] = static_cast<std::int16_t>(product(from[i], w[i]) + product(from[i + kChannels], w[stride + i]) +
                                      product(from[i + 2 * kChannels], w[2 * stride + i]) +
                                      product(from[i + 3 * kChannels], w[3 * stride + i]) +
                                      product(from[i + 4 * kChannels], w[4 * stride + i]) +
                                      product(from[i + 5 * kChannels], w[5 * stride + i]) + kCutOff);
  }
}

using TapRows = std::array<const std::int16_t*, kTaps>;

inline std::uint8_t toCode(int sum) {
  const auto rounded = static_cast<std::int16_t>(
      static_cast<std::int16_t>(sum + kCutOff + (1 << (kOutputBits - 1))) >> kOutputBits);
  return static_cast<std::uint8_t>(std::min<std::int16_t>(std::max<std::int16_t>(rounded, 0), 255));
}

ALL_IN_FOCUS_SIMD void combineAcross(const TapRows& rows, const std::array<std::int16_t, kTaps>& w, int n,
                                     std::uint8_t* __restrict to) {
  const std::int16_t *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3], *e = rows[4], *f = rows[5];
  for (int i = 0; i < n; ++i) {
    to[i] = toCode(product(a[i], w[0]) + product(b[i], w[1]) + product(c[i], w[2]) + product(d[i], w[3]) +
                   product(e[i], w[4]) + product(f[i], w[5]));
  }
}

// Values begin .. end - 1, each with weights of its own.
ALL_IN_FOCUS_SIMD void combineAcrossRun(const TapRows& rows, const std::int16_t* w, size_t stride, int begin,
                                        int end, std::uint8_t* __restrict to) {
  const std::int16_t *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3], *e = rows[4], *f = rows[5];
  for (int i = begin; i < end; ++i) {
    to[i] = toCode(product(a[i], w[i]) + product(b[i], w[stride + i]) + product(c[i], w[2 * stride + i]) +
                   product(d[i], w[3 * stride + i]) + product(e[i], w[4 * stride + i]) +
                   product(f[i], w[5 * stride + i]));
  }
}

}  // namespace

// Beyond the border all taps read the border pixel.
void ReferenceWarp::Taps::prepare(double begin, double step, int count, int length, int channels) {
  const std::array<Weights, kSteps + 1>& table = lanczos();
  first.resize(count);
  weights.resize(static_cast<size_t>(kTaps) * channels * count);
  if (channels > 1) single.resize(static_cast<size_t>(kTaps) * count);
  std::int16_t* const of_positions = channels > 1 ? single.data() : weights.data();
  ends.clear();
  const double last = length + 2;
  for (int i = 0; i < count; ++i) {
    const double inside = std::min(std::max(begin + step * i, -3.0), last);
    const int whole = static_cast<int>(inside + 4) - 4;
    first[i] = whole - (kTaps / 2 - 1);
    const Weights& w = table[static_cast<int>((inside - whole) * kSteps + 0.5)];
    for (int k = 0; k < kTaps; ++k) of_positions[k * count + i] = w[k];
    if (i > 0 && first[i] != first[i - 1] + 1) ends.push_back(i);
  }
  ends.push_back(count);
  if (channels == kChannels) threeTimes(single.data(), kTaps * count, weights.data());
}

void ReferenceWarp::compute(const cv::Mat& frame, const SimilarityTransform& transform,
                            const cv::Point2d& center, cv::Mat& out) {
  if (frame.type() != CV_8UC3 && frame.type() != CV_16UC3)
    throw std::invalid_argument("warp: the frame must be CV_8UC3 or CV_16UC3");
  if (transform.isIdentity()) return frame.copyTo(out);
  if (frame.depth() == CV_16U) {
    cv::warpAffine(frame, out, transform.matrix(center), frame.size(),
                   cv::INTER_LANCZOS4 | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
    return;
  }
  out.create(frame.size(), CV_8UC3);
  const double scale = transform.scale;
  if (transform.angle == 0) {
    columns_.prepare(center.x - scale * center.x + transform.shift.x, scale, frame.cols, frame.cols,
                     kChannels);
    rows_.prepare(center.y - scale * center.y + transform.shift.y, scale, frame.rows, frame.rows, 1);
  }
  // Rows of the frame that one row of the output is made of.
  const double slope = scale * std::sin(transform.angle);
  const int kept = std::min(static_cast<int>(std::abs(slope) * frame.cols) + kTaps + 2, frame.rows + 1);
  const int values = kChannels * frame.cols;
  strips_.resize(stripCount(frame.rows));
  for (Strip& strip : strips_) {
    strip.along.begin(std::max(kept, 8), values);
    strip.padded.resize(values + 2 * kChannels * kBorder);
  }
  RowStrips({0, frame.rows}, static_cast<int>(strips_.size())).forEach([&](const cv::Range& rows, int i) {
    computeStrip(frame, transform, center, rows, strips_[i], out);
  });
}

void ReferenceWarp::computeStrip(const cv::Mat& frame, const SimilarityTransform& transform,
                                 const cv::Point2d& center, const cv::Range& rows, Strip& strip,
                                 cv::Mat& out) const {
  const double cosine = std::cos(transform.angle), sine = std::sin(transform.angle);
  const bool rolls = transform.angle != 0;
  const int columns = frame.cols, values = kChannels * columns;
  std::int16_t* padded = strip.padded.data() + kChannels * kBorder;

  const auto along = [&](int v, std::int16_t* row) {
    toFixedPoint(frame.ptr(v), values, padded);
    for (int i = 0; i < kChannels * kBorder; ++i) {
      padded[-1 - i] = padded[kChannels - 1 - i % kChannels];
      padded[values + i] = padded[values - kChannels + i % kChannels];
    }
    if (rolls) {
      const double step = transform.scale / cosine;
      const double sheared = sine / cosine * (v - center.y - transform.shift.y);
      strip.sheared.prepare(center.x - step * center.x - sheared + transform.shift.x, step, columns, columns,
                            kChannels);
    }
    const Taps& taps = rolls ? strip.sheared : columns_;
    int x = 0;
    for (const int end : taps.ends) {
      combineAlong(padded + kChannels * taps.first[x], taps.weights.data() + kChannels * x, values,
                   kChannels * (end - x), row + kChannels * x);
      x = end;
    }
  };
  const auto tapRows = [&](int first) {
    TapRows from;
    for (int k = 0; k < kTaps; ++k) {
      from[k] = strip.along.row(std::clamp(first + k, 0, frame.rows - 1), along);
    }
    return from;
  };

  Taps& across = strip.across;
  for (int y = rows.start; y < rows.end; ++y) {
    if (!rolls) {
      std::array<std::int16_t, kTaps> weight;
      for (int k = 0; k < kTaps; ++k) weight[k] = rows_.weights[static_cast<size_t>(k) * frame.rows + y];
      combineAcross(tapRows(rows_.first[y]), weight, values, out.ptr(y));
      continue;
    }
    const double step = transform.scale * sine;
    const double level = center.y + transform.scale * cosine * (y - center.y) + transform.shift.y;
    across.prepare(level - step * center.x, step, columns, frame.rows, kChannels);
    for (int x = 0, end = 0; x < columns; x = end) {
      for (end = x + 1; end < columns && across.first[end] == across.first[x];) ++end;
      combineAcrossRun(tapRows(across.first[x]), across.weights.data(), values, kChannels * x,
                       kChannels * end, out.ptr(y));
    }
  }
}

}  // namespace all_in_focus::core
