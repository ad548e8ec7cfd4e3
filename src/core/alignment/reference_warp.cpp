// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/reference_warp.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kTaps = 6;
constexpr int kChannels = 3;
constexpr int kSteps = 2048;       // of a pixel: positions are rounded to these
constexpr int kTileColumns = 256;  // worked on at a time: their weights stay in the L1 cache

using Weights = std::array<float, kTaps>;

// The kernel sinc(x) sinc(x / 3) at x = fraction + 2, + 1, ... - 3, by steps of the fraction; the sum is 1.
const std::array<Weights, kSteps + 1>& lanczos() {
  static const auto table = [] {
    const auto sinc = [](double x) { return x == 0 ? 1 : std::sin(CV_PI * x) / (CV_PI * x); };
    std::array<Weights, kSteps + 1> weights;
    for (int i = 0; i <= kSteps; ++i) {
      float sum = 0;
      for (int k = 0; k < kTaps; ++k) {
        const double x = static_cast<double>(i) / kSteps + 2 - k;
        sum += weights[i][k] = static_cast<float>(sinc(x) * sinc(x / 3));
      }
      for (float& weight : weights[i]) weight /= sum;
    }
    return weights;
  }();
  return table;
}

// Every value has weights of its own: w[i], w[stride + i], ...
ALL_IN_FOCUS_SIMD void combineAlong(const float* from, const float* w, int stride, int n,
                                    float* __restrict to) {
  for (int i = 0; i < n; ++i) {
    to[i] = from[i] * w[i] + from[i + kChannels] * w[stride + i] +
            from[i + 2 * kChannels] * w[2 * stride + i] + from[i + 3 * kChannels] * w[3 * stride + i] +
            from[i + 4 * kChannels] * w[4 * stride + i] + from[i + 5 * kChannels] * w[5 * stride + i];
  }
}

using TapRows = std::array<const float*, kTaps>;

ALL_IN_FOCUS_SIMD void combineAcross(const TapRows& rows, const float* w, int n, float* __restrict to) {
  const float *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3], *e = rows[4], *f = rows[5];
  for (int i = 0; i < n; ++i)
    to[i] = a[i] * w[0] + b[i] * w[1] + c[i] * w[2] + d[i] * w[3] + e[i] * w[4] + f[i] * w[5];
}

// Six taps at a position among pixels 0..length-1. Beyond the border only one tap counts, and it
// reads the pixel at the border.
struct Tap {
  int first;
  const Weights& weights;
};

Tap tapAt(double position, int length) {
  const double inside = std::clamp(position, -2.0, length + 1.0);
  const int whole = cvFloor(inside);
  return {whole - (kTaps / 2 - 1), lanczos()[static_cast<std::size_t>((inside - whole) * kSteps + 0.5)]};
}

// Taps at all pixels of a row.
struct RowTaps {
  std::vector<int> first;
  std::vector<float> weights;  // by tap, position, channel
  std::vector<int> ends;       // of runs of positions whose first taps lie side by side: one loop each
};

RowTaps rowTaps(double begin, double step, int count) {
  RowTaps taps;
  taps.weights.resize(static_cast<std::size_t>(kTaps) * kChannels * count);
  for (int i = 0; i < count; ++i) {
    const Tap tap = tapAt(begin + step * i, count);
    for (int k = 0; k < kTaps; ++k)
      std::fill_n(&taps.weights[kChannels * (k * count + i)], kChannels, tap.weights[k]);
    if (i > 0 && tap.first != taps.first.back() + 1) taps.ends.push_back(i);
    taps.first.push_back(tap.first);
  }
  taps.ends.push_back(count);
  return taps;
}

// Reads the pixels of some columns along a row. values: of the frame's row, from that of the first tap on.
void readAlong(const float* values, const RowTaps& taps, const cv::Range& columns, float* out) {
  const int stride = kChannels * static_cast<int>(taps.first.size());
  int x = columns.start;
  for (const int end_of_run : taps.ends) {
    const int end = std::min(end_of_run, columns.end);
    if (end <= x) continue;
    combineAlong(values + kChannels * (taps.first[x] - taps.first[columns.start]),
                 taps.weights.data() + kChannels * x, stride, kChannels * (end - x), out);
    out += kChannels * (end - x);
    x = end;
  }
}

}  // namespace

cv::Mat warpedToReference(const cv::Mat& frame, const SimilarityTransform& transform,
                          const cv::Point2d& center) {
  if (transform.isIdentity()) return frame.clone();
  cv::Mat out(frame.size(), frame.type());
  if (transform.angle != 0) {
    cv::warpAffine(frame, out, transform.matrix(center), frame.size(), cv::INTER_CUBIC | cv::WARP_INVERSE_MAP,
                   cv::BORDER_REPLICATE);
    return out;
  }
  const cv::Point2d begin = transform.apply({}, center);
  const RowTaps columns = rowTaps(begin.x, transform.scale, frame.cols);
  const auto tapAtRow = [&](int y) { return tapAt(begin.y + transform.scale * y, frame.rows); };
  forEachBlock({0, frame.rows}, [&](const cv::Range& rows) {
    // The rows of the frame that the block is made of.
    const int last = frame.rows - 1, from = std::clamp(tapAtRow(rows.start).first, 0, last),
              to = std::clamp(tapAtRow(rows.end - 1).first + kTaps - 1, 0, last);
    for (int x = 0; x < frame.cols; x += kTileColumns) {
      const cv::Range tile(x, std::min(x + kTileColumns, frame.cols));
      const cv::Range read(columns.first[tile.start], columns.first[tile.end - 1] + kTaps),
          inside = read & cv::Range(0, frame.cols);
      cv::Mat values;
      frame({from, to + 1}, inside).convertTo(values, CV_32F);
      if (inside != read) {
        cv::copyMakeBorder(values.clone(), values, 0, 0, inside.start - read.start, read.end - inside.end,
                           cv::BORDER_REPLICATE);
      }
      cv::Mat1f along(values.rows, kChannels * tile.size());
      for (int v = 0; v < values.rows; ++v) readAlong(values.ptr<float>(v), columns, tile, along[v]);
      cv::Mat pixels(rows.size(), tile.size(), CV_32FC3);
      for (int y = rows.start; y < rows.end; ++y) {
        const Tap tap = tapAtRow(y);
        TapRows tap_rows;
        for (int k = 0; k < kTaps; ++k) tap_rows[k] = along[std::clamp(tap.first + k, 0, last) - from];
        combineAcross(tap_rows, tap.weights.data(), along.cols, pixels.ptr<float>(y - rows.start));
      }
      pixels.convertTo(out(rows, tile), out.type());
    }
  });
  return out;
}

}  // namespace all_in_focus::core
