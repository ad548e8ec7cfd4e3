// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/reference_warp.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>

#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kTaps = 6;
constexpr int kChannels = 3;
constexpr int kBorder = 3 + kTaps;  // pixels that taps may lie beyond a border
constexpr int kDegree = 6;          // of the polynomials for the kernel: right to 5e-5

// Lanczos kernel sinc(x) sinc(x / 3) at x = fraction + 2, + 1, ... - 3; 0 <= fraction < 1; scaled to sum 1.
std::array<double, kTaps> lanczos(double fraction) {
  std::array<double, kTaps> weight{};
  if (fraction < 1e-9) {
    weight[2] = 1;
    return weight;
  }
  // sin(pi x) only changes its sign from tap to tap, and pi x / 3 its angle by 60 degrees.
  constexpr double kCos[] = {-0.5, 0.5, 1, 0.5, -0.5, -1};
  const double half_root = std::sqrt(3) / 2;
  const double sines[] = {half_root, half_root, 0, -half_root, -half_root, 0};
  const double sine = std::sin(CV_PI / 3 * fraction), cosine = std::cos(CV_PI / 3 * fraction);
  double sum = 0;
  for (int k = 0; k < kTaps; ++k) {
    const double x = fraction + 2 - k;
    weight[k] = (k % 2 == 0 ? 1 : -1) * (sine * kCos[k] + cosine * sines[k]) / (x * x);
    sum += weight[k];
  }
  for (double& w : weight) w /= sum;
  return weight;
}

// The same as polynomials of t = 2 fraction - 1, which vectors compute: through the kernel at Chebyshev's
// nodes.
using Polynomials = std::array<std::array<float, kDegree + 1>, kTaps>;

Polynomials fitLanczos() {
  cv::Mat powers(kDegree + 1, kDegree + 1, CV_64F), values(kDegree + 1, kTaps, CV_64F), coefficients;
  for (int i = 0; i <= kDegree; ++i) {
    const double t = std::cos(CV_PI * (i + 0.5) / (kDegree + 1));
    const std::array<double, kTaps> weight = lanczos((t + 1) / 2);
    for (int k = 0; k <= kDegree; ++k) powers.at<double>(i, k) = std::pow(t, k);
    for (int k = 0; k < kTaps; ++k) values.at<double>(i, k) = weight[k];
  }
  cv::solve(powers, values, coefficients);
  Polynomials polynomials;
  for (int k = 0; k < kTaps; ++k) {
    for (int i = 0; i <= kDegree; ++i) polynomials[k][i] = static_cast<float>(coefficients.at<double>(i, k));
  }
  return polynomials;
}

// Fixed point. A product keeps the upper 16 of its 32 bits, so gray levels lose a bit with each pass. Six
// products cut off three units on average, which kCutOff gives back.
constexpr float kOne = 1 << 15;     // of weights
constexpr int kLargest = 32767;     // weight, instead of 1
constexpr int kInputBits = 7;       // behind the point of a gray level
constexpr int kOutputBits = 5;      // after two passes
constexpr int kCutOff = kTaps / 2;  // units

inline int product(std::int16_t value, std::int16_t weight) {
  return (value * weight) >> 16;
}

// Beyond the border all taps read the border pixel.
ALL_IN_FOCUS_SIMD void findTaps(double begin, double step, int n, int length, int* __restrict first,
                                float* __restrict fraction) {
  const double last = length + 2;
  for (int i = 0; i < n; ++i) {
    const double inside = std::min(std::max(begin + step * i, -3.0), last);
    const int whole = static_cast<int>(inside + 4) - 4;
    first[i] = whole - (kTaps / 2 - 1);
    fraction[i] = static_cast<float>(inside - whole);
  }
}

// Weights of one tap.
ALL_IN_FOCUS_SIMD void evaluate(const std::array<float, kDegree + 1>& c, const float* fraction, int n,
                                std::int16_t* __restrict weight) {
  for (int i = 0; i < n; ++i) {
    const float t = 2 * fraction[i] - 1;
    float sum = c[kDegree];
    for (int k = kDegree - 1; k >= 0; --k) sum = sum * t + c[k];
    const int rounded = static_cast<int>(kOne * sum + (kOne + 0.5f)) - static_cast<int>(kOne);
    weight[i] = static_cast<std::int16_t>(std::min(rounded, kLargest));
  }
}

// Sets the third of the six weights of each position to what the others leave of 1: flat places keep their
// level.
ALL_IN_FOCUS_SIMD void complete(std::int16_t* weights, int n) {
  std::int16_t* __restrict third = weights + 2 * n;
  const std::int16_t *a = weights, *b = a + n, *d = b + 2 * n, *e = d + n, *f = e + n;
  for (int i = 0; i < n; ++i) {
    third[i] = static_cast<std::int16_t>(std::min(kLargest + 1 - a[i] - b[i] - d[i] - e[i] - f[i], kLargest));
  }
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

void ReferenceWarp::Taps::prepare(double begin, double step, int count, int length, int channels) {
  static const Polynomials polynomials = fitLanczos();
  first.resize(count);
  fraction.resize(count);
  weights.resize(static_cast<size_t>(kTaps) * channels * count);
  if (channels > 1) single.resize(static_cast<size_t>(kTaps) * count);
  std::vector<std::int16_t>& of_positions = channels > 1 ? single : weights;
  findTaps(begin, step, count, length, first.data(), fraction.data());
  for (const int k : {0, 1, 3, 4, 5}) {
    evaluate(polynomials[k], fraction.data(), count, &of_positions[static_cast<size_t>(k) * count]);
  }
  complete(of_positions.data(), count);
  if (channels == kChannels) threeTimes(single.data(), kTaps * count, weights.data());
  ends.clear();
  for (int u = 1; u <= count; ++u) {
    if (u == count || first[u] != first[u - 1] + 1) ends.push_back(u);
  }
}

void ReferenceWarp::compute(const cv::Mat& frame, const SimilarityTransform& transform,
                            const cv::Point2d& center, cv::Mat& out) {
  if (frame.type() != CV_8UC3) throw std::invalid_argument("warp: the frame must be CV_8UC3");
  if (transform.isIdentity()) return frame.copyTo(out);
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
