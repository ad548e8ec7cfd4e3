// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/frame_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>

#include "util/rounding.hpp"
#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kTaps = ReferenceWarp::kTaps;
constexpr int kChannels = 3;
constexpr int kBorder = 3 + kTaps;  // pixels that taps may lie beyond a border
constexpr int kKept = 8;            // rows, at least kTaps

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

ALL_IN_FOCUS_SIMD void toFloat(const std::uint8_t* from, int n, float* __restrict to) {
  for (int i = 0; i < n; ++i) to[i] = from[i];
}

// Every value has weights of its own: w[i], w[stride + i], ...
ALL_IN_FOCUS_SIMD void combineAlong(const float* from, const float* w, size_t stride, int n,
                                    float* __restrict to) {
  for (int i = 0; i < n; ++i) {
    to[i] = w[i] * from[i] + w[stride + i] * from[i + kChannels] +
            w[2 * stride + i] * from[i + 2 * kChannels] + w[3 * stride + i] * from[i + 3 * kChannels] +
            w[4 * stride + i] * from[i + 4 * kChannels] + w[5 * stride + i] * from[i + 5 * kChannels];
  }
}

ALL_IN_FOCUS_SIMD void combineAcross(const std::array<const float*, kTaps>& rows,
                                     const std::array<float, kTaps>& w, int n, std::uint8_t* __restrict to) {
  const float *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3], *e = rows[4], *f = rows[5];
  for (int i = 0; i < n; ++i) {
    const float sum = w[0] * a[i] + w[1] * b[i] + w[2] * c[i] + w[3] * d[i] + w[4] * e[i] + w[5] * f[i];
    to[i] = roundToCode(sum);
  }
}

}  // namespace

Motion chain(const Motion& first, const Motion& second) {
  return {second.scale * first.scale, second.scale * first.shift + second.shift};
}

Motion inverse(const Motion& motion) {
  return {1 / motion.scale, motion.shift * (-1 / motion.scale)};
}

double largestDisplacement(const Motion& motion, const cv::Size& size, const cv::Point2d& center) {
  double largest = 0;
  for (const double x : {0, size.width - 1}) {
    for (const double y : {0, size.height - 1}) {
      largest = std::max(largest, cv::norm((motion.scale - 1) * (cv::Point2d(x, y) - center) + motion.shift));
    }
  }
  return largest;
}

// Taps of every output coordinate u at u' = center + scale (u - center) + shift.
void ReferenceWarp::Axis::prepare(int length, double scale, double center, double shift) {
  first.resize(length);
  weight.resize(length);
  for (int u = 0; u < length; ++u) {
    const double from = center + scale * (u - center) + shift;
    // Beyond the border all taps read the border pixel.
    const double inside = std::clamp(from, -3.0, length + 2.0), whole = std::floor(inside);
    first[u] = static_cast<int>(whole) - (kTaps / 2 - 1);
    const std::array<double, kTaps> weights = lanczos(inside - whole);
    std::transform(weights.begin(), weights.end(), weight[u].begin(),
                   [](double w) { return static_cast<float>(w); });
  }
}

void ReferenceWarp::compute(const cv::Mat& frame, const Motion& motion, const cv::Point2d& center,
                            cv::Mat& out) {
  if (frame.type() != CV_8UC3) throw std::invalid_argument("warp: the frame must be CV_8UC3");
  if (motion.isIdentity()) return frame.copyTo(out);
  out.create(frame.size(), CV_8UC3);
  rows_.prepare(frame.rows, motion.scale, center.y, motion.shift.y);
  prepareColumns(frame.cols, motion, center);
  const int values = kChannels * frame.cols;
  strips_.resize(stripCount(frame.rows));
  for (Strip& strip : strips_) {
    strip.along.begin(kKept, values);
    strip.padded.resize(values + 2 * kChannels * kBorder);
  }
  RowStrips({0, frame.rows}, static_cast<int>(strips_.size())).forEach([&](const cv::Range& rows, int i) {
    const auto along = [&](int v, float* row) { warpAlong(frame.ptr(v), strips_[i].padded, row); };
    for (int y = rows.start; y < rows.end; ++y) {
      std::array<const float*, kTaps> from;
      for (int k = 0; k < kTaps; ++k) {
        from[k] = strips_[i].along.row(std::clamp(rows_.first[y] + k, 0, frame.rows - 1), along);
      }
      combineAcross(from, rows_.weight[y], values, out.ptr(y));
    }
  });
}

void ReferenceWarp::prepareColumns(int columns, const Motion& motion, const cv::Point2d& center) {
  columns_.prepare(columns, motion.scale, center.x, motion.shift.x);
  runs_.clear();
  column_weights_.resize(static_cast<size_t>(kTaps) * kChannels * columns);
  for (int x = 0; x < columns; ++x) {
    appendToRuns(runs_, x, columns_.first[x]);
    for (int k = 0; k < kTaps; ++k) {
      std::fill_n(&column_weights_[static_cast<size_t>(kChannels) * (k * columns + x)], kChannels,
                  columns_.weight[x][k]);
    }
  }
}

void ReferenceWarp::warpAlong(const std::uint8_t* from, std::vector<float>& padded, float* out) const {
  const int values = static_cast<int>(padded.size()) - 2 * kChannels * kBorder;
  float* row = padded.data() + kChannels * kBorder;
  toFloat(from, values, row);
  for (int i = 0; i < kChannels * kBorder; ++i) {
    row[-1 - i] = row[kChannels - 1 - i % kChannels];
    row[values + i] = row[values - kChannels + i % kChannels];
  }
  for (const TapRun& run : runs_) {
    const int begin = kChannels * run.begin;
    combineAlong(row + begin + kChannels * run.offset, column_weights_.data() + begin, values,
                 kChannels * run.end - begin, out + begin);
  }
}

}  // namespace all_in_focus::core
