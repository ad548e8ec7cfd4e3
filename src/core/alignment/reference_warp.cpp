// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/reference_warp.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <type_traits>
#include <vector>

#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kTaps = 6;
constexpr int kChannels = 3;
constexpr int kSteps = 2048;       // of a pixel: positions are rounded to these
constexpr int kTileColumns = 256;  // worked on at a time: their weights stay in the L1 cache
constexpr int kVector = 16;        // values of a vector; loops over whole ones are faster

// Codes of 8 bits are combined in fixed point, in half the time of floats: a tenth of what a frame takes.
using Fixed = std::int16_t;
constexpr int kInputBits = 7;  // behind the point of a code
// A product keeps the upper 16 of its 32 bits, so each pass leaves one bit less behind the point. The six
// products of a sum lose three units on average, which are added again.
constexpr int kOutputBits = kInputBits - 2, kLost = kTaps / 2;

template <typename Value>
using Weights = std::array<Value, kTaps>;

// The kernel sinc(x) sinc(x / 3) at x = fraction + 2, + 1, ... - 3, by steps of the fraction; the sum is 1.
template <typename Value>
const std::array<Weights<Value>, kSteps + 1>& lanczos() {
  constexpr double kOne = std::is_same_v<Value, Fixed> ? 1 << 15 : 1;
  static const auto table = [] {
    const auto sinc = [](double x) { return x == 0 ? 1 : std::sin(CV_PI * x) / (CV_PI * x); };
    std::array<Weights<Value>, kSteps + 1> weights;
    for (int i = 0; i <= kSteps; ++i) {
      std::array<double, kTaps> kernel;
      for (int k = 0; k < kTaps; ++k) {
        const double x = static_cast<double>(i) / kSteps + 2 - k;
        kernel[k] = sinc(x) * sinc(x / 3);
      }
      const double sum = std::accumulate(kernel.begin(), kernel.end(), 0.0);
      for (int k = 0; k < kTaps; ++k) weights[i][k] = cv::saturate_cast<Value>(kOne * kernel[k] / sum);
    }
    return weights;
  }();
  return table;
}

inline float product(float value, float weight) {
  return value * weight;
}

inline int product(Fixed value, Fixed weight) {
  return (value * weight) >> 16;
}

ALL_IN_FOCUS_SIMD void read(const std::uint8_t* codes, int n, Fixed* __restrict values) {
  for (int i = 0; i < n; ++i) values[i] = static_cast<Fixed>(codes[i] << kInputBits);
}

ALL_IN_FOCUS_SIMD void read(const std::uint16_t* codes, int n, float* __restrict values) {
  for (int i = 0; i < n; ++i) values[i] = codes[i];
}

// Every value has weights of its own: w[i], w[stride + i], ...
template <typename Value>
inline auto sumAlong(const Value* from, const Value* w, int stride, int i) {
  return product(from[i], w[i]) + product(from[i + kChannels], w[stride + i]) +
         product(from[i + 2 * kChannels], w[2 * stride + i]) +
         product(from[i + 3 * kChannels], w[3 * stride + i]) +
         product(from[i + 4 * kChannels], w[4 * stride + i]) +
         product(from[i + 5 * kChannels], w[5 * stride + i]);
}

ALL_IN_FOCUS_SIMD void combineAlong(const Fixed* from, const Fixed* w, int stride, int n,
                                    Fixed* __restrict to) {
  for (int i = 0; i < n; ++i) to[i] = static_cast<Fixed>(sumAlong(from, w, stride, i) + kLost);
}

ALL_IN_FOCUS_SIMD void combineAlong(const float* from, const float* w, int stride, int n,
                                    float* __restrict to) {
  for (int i = 0; i < n; ++i) to[i] = sumAlong(from, w, stride, i);
}

template <typename Value>
using TapRows = std::array<const Value*, kTaps>;

template <typename Value>
inline auto sumAcross(const TapRows<Value>& rows, const Weights<Value>& w, int i) {
  return product(rows[0][i], w[0]) + product(rows[1][i], w[1]) + product(rows[2][i], w[2]) +
         product(rows[3][i], w[3]) + product(rows[4][i], w[4]) + product(rows[5][i], w[5]);
}

ALL_IN_FOCUS_SIMD void combineAcross(TapRows<Fixed> rows, Weights<Fixed> w, int n,
                                     std::uint8_t* __restrict to) {
  constexpr int kHalf = 1 << (kOutputBits - 1);
  for (int i = 0; i < n; ++i) {
    const auto sum = static_cast<Fixed>(sumAcross(rows, w, i) + kLost + kHalf);
    to[i] = static_cast<std::uint8_t>(std::clamp<Fixed>(static_cast<Fixed>(sum >> kOutputBits), 0, 255));
  }
}

ALL_IN_FOCUS_SIMD void combineAcross(TapRows<float> rows, Weights<float> w, int n,
                                     std::uint16_t* __restrict to) {
  for (int i = 0; i < n; ++i) {
    const float sum = std::clamp(sumAcross(rows, w, i), 0.0f, 65535.0f);
    to[i] = static_cast<std::uint16_t>(static_cast<int>(sum + 0.5f));
  }
}

// Six taps at a position among pixels 0..length-1. Beyond the border only one tap counts, and it
// reads the pixel at the border.
template <typename Value>
struct Tap {
  int first;
  const Weights<Value>& weights;
};

template <typename Value>
Tap<Value> tapAt(double position, int length) {
  const double inside = std::clamp(position, -2.0, length + 1.0);
  const int whole = cvFloor(inside);
  return {whole - (kTaps / 2 - 1),
          lanczos<Value>()[static_cast<std::size_t>((inside - whole) * kSteps + 0.5)]};
}

// Taps at all pixels of a row.
template <typename Value>
struct RowTaps {
  std::vector<int> first;
  std::vector<Value> weights;  // by tap, position, channel
  std::vector<int> ends;       // of runs of positions whose first taps lie side by side: one loop each
};

template <typename Value>
RowTaps<Value> rowTaps(double begin, double step, int count) {
  RowTaps<Value> taps;
  taps.weights.resize(static_cast<std::size_t>(kTaps) * kChannels * count + kVector);
  for (int i = 0; i < count; ++i) {
    const Tap<Value> tap = tapAt<Value>(begin + step * i, count);
    for (int k = 0; k < kTaps; ++k)
      std::fill_n(&taps.weights[kChannels * (k * count + i)], kChannels, tap.weights[k]);
    if (i > 0 && tap.first != taps.first.back() + 1) taps.ends.push_back(i);
    taps.first.push_back(tap.first);
  }
  taps.ends.push_back(count);
  return taps;
}

// Reads the pixels of some columns along a row. values: of the frame's row, from that of the first tap on.
// Each run is a number of whole vectors: the next one writes anew what is too much of it, so values and out
// have room for a vector more.
template <typename Value>
void readAlong(const Value* values, const RowTaps<Value>& taps, const cv::Range& columns, Value* out) {
  const int stride = kChannels * static_cast<int>(taps.first.size());
  int x = columns.start;
  for (const int end_of_run : taps.ends) {
    const int end = std::min(end_of_run, columns.end);
    if (end <= x) continue;
    combineAlong(values + kChannels * (taps.first[x] - taps.first[columns.start]),
                 taps.weights.data() + kChannels * x, stride,
                 (kChannels * (end - x) + kVector - 1) / kVector * kVector, out);
    out += kChannels * (end - x);
    x = end;
  }
}

// begin, scale: the pixel (x, y) of the result lies at begin + scale (x, y) of the frame.
template <typename Code, typename Value>
void warp(const cv::Mat& frame, const cv::Point2d& begin, double scale, cv::Mat& out) {
  const RowTaps<Value> columns = rowTaps<Value>(begin.x, scale, frame.cols);
  const auto tapAtRow = [&](int y) { return tapAt<Value>(begin.y + scale * y, frame.rows); };
  forEachBlock({0, frame.rows}, [&](const cv::Range& rows) {
    // The rows of the frame that the block is made of.
    const int last = frame.rows - 1, from = std::clamp(tapAtRow(rows.start).first, 0, last),
              to = std::clamp(tapAtRow(rows.end - 1).first + kTaps - 1, 0, last);
    std::vector<Value> values;
    cv::Mat_<Value> along(to - from + 1, kChannels * kTileColumns + kVector);
    for (int x = 0; x < frame.cols; x += kTileColumns) {
      const cv::Range tile(x, std::min(x + kTileColumns, frame.cols));
      const cv::Range reach(columns.first[tile.start], columns.first[tile.end - 1] + kTaps),
          inside = reach & cv::Range(0, frame.cols);
      values.resize(static_cast<std::size_t>(kChannels) * reach.size() + kVector);
      const auto first = values.begin() + kChannels * (inside.start - reach.start);
      for (int v = from; v <= to; ++v) {
        const Code* codes = frame.ptr<Code>(v) + kChannels * inside.start;
        read(codes, kChannels * inside.size(), &*first);
        auto after = first + kChannels * inside.size();
        for (auto before = first; before != values.begin(); --before) before[-1] = before[kChannels - 1];
        for (; after != values.end(); ++after) *after = after[-kChannels];
        readAlong(values.data(), columns, tile, along[v - from]);
      }
      for (int y = rows.start; y < rows.end; ++y) {
        const Tap<Value> tap = tapAtRow(y);
        TapRows<Value> tap_rows;
        for (int k = 0; k < kTaps; ++k) tap_rows[k] = along[std::clamp(tap.first + k, 0, last) - from];
        combineAcross(tap_rows, tap.weights, kChannels * tile.size(), out.ptr<Code>(y) + kChannels * x);
      }
    }
  });
}

}  // namespace

cv::Mat warpedToReference(const cv::Mat& frame, const SimilarityTransform& transform,
                          const cv::Point2d& center) {
  if (transform.isIdentity()) return frame.clone();
  cv::Mat out(frame.size(), frame.type());
  const cv::Point2d begin = transform.apply({}, center);
  if (transform.angle != 0) {
    cv::warpAffine(frame, out, transform.matrix(center), frame.size(), cv::INTER_CUBIC | cv::WARP_INVERSE_MAP,
                   cv::BORDER_REPLICATE);
  } else if (frame.depth() == CV_8U) {
    warp<std::uint8_t, Fixed>(frame, begin, transform.scale, out);
  } else {
    warp<std::uint16_t, float>(frame, begin, transform.scale, out);
  }
  return out;
}

}  // namespace all_in_focus::core
