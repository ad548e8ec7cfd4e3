// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "util/image_rows.hpp"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kRadius = GaussianRows::kRadius;
using Window = GaussianRows::Window;

ALL_IN_FOCUS_SIMD void convolveAlong(const float* row, const Window& w, int n, float* __restrict out) {
  for (int i = 0; i < n; ++i) {
    const float* p = row + i;
    out[i] = w[0] * p[0] + w[1] * (p[-1] + p[1]) + w[2] * (p[-2] + p[2]) + w[3] * (p[-3] + p[3]) +
             w[4] * (p[-4] + p[4]) + w[5] * (p[-5] + p[5]);
  }
}

ALL_IN_FOCUS_SIMD void convolveAcross(const std::array<const float*, 2 * kRadius + 1>& rows, const Window& w,
                                      int n, float* __restrict out) {
  const float *n5 = rows[0], *n4 = rows[1], *n3 = rows[2], *n2 = rows[3], *n1 = rows[4], *here = rows[5];
  const float *s1 = rows[6], *s2 = rows[7], *s3 = rows[8], *s4 = rows[9], *s5 = rows[10];
  for (int i = 0; i < n; ++i) {
    out[i] = w[0] * here[i] + w[1] * (n1[i] + s1[i]) + w[2] * (n2[i] + s2[i]) + w[3] * (n3[i] + s3[i]) +
             w[4] * (n4[i] + s4[i]) + w[5] * (n5[i] + s5[i]);
  }
}

ALL_IN_FOCUS_SIMD void addShare(const float* row, float share, int n, float* __restrict sum) {
  for (int i = 0; i < n; ++i) sum[i] += share * row[i];
}

ALL_IN_FOCUS_SIMD void interpolateAlong(const float* from, const int* first, const int* second,
                                        const float* fraction, int n, float* __restrict to) {
  for (int i = 0; i < n; ++i) to[i] = from[first[i]] * (1 - fraction[i]) + from[second[i]] * fraction[i];
}

ALL_IN_FOCUS_SIMD void interpolateAcross(const float* north, const float* south, float fraction, int n,
                                         float* __restrict to) {
  for (int i = 0; i < n; ++i) to[i] = north[i] * (1 - fraction) + south[i] * fraction;
}

}  // namespace

void KeptRows::begin(int kept, int width) {
  width_ = static_cast<size_t>(width);
  rows_.resize(kept * width_);
  kept_y_.assign(kept, -1);
}

void appendToRuns(std::vector<TapRun>& runs, int u, int first) {
  if (runs.empty() || runs.back().offset != first - u) runs.push_back({u, u, first - u});
  ++runs.back().end;
}

void GaussianRows::begin(const cv::Size& size, double sigma) {
  double sum = 0;
  std::array<double, kRadius + 1> window;
  for (int k = 0; k <= kRadius; ++k) {
    window[k] = std::exp(-0.5 * k * k / (sigma * sigma));
    sum += k == 0 ? window[k] : 2 * window[k];
  }
  for (int k = 0; k <= kRadius; ++k) window_[k] = static_cast<float>(window[k] / sum);
  size_ = size;
  along_.begin(2 * kRadius + 1, size.width);
  padded_.resize(size.width + 2 * kRadius);
}

void GaussianRows::smoothAlong(float* out) {
  float* row = padded_.data() + kRadius;
  for (int k = 1; k <= kRadius; ++k) {
    const int end = size_.width - 1 + k;
    row[-k] = row[cv::borderInterpolate(-k, size_.width, cv::BORDER_REFLECT_101)];
    row[end] = row[cv::borderInterpolate(end, size_.width, cv::BORDER_REFLECT_101)];
  }
  convolveAlong(row, window_, size_.width, out);
}

void GaussianRows::smoothAcross(const std::array<const float*, 2 * kRadius + 1>& rows, float* out) const {
  convolveAcross(rows, window_, size_.width, out);
}

void ReducedRows::begin(const cv::Size& large, const cv::Size& small) {
  if (large == large_ && small == small_) return;
  large_ = large;
  small_ = small;
  x_.begin(large.width, small.width);
  y_.begin(large.height, small.height);
  sum_.assign(large.width + x_.taps, 0.0f);
}

void ReducedRows::Axis::begin(int large, int small) {
  const double scale = static_cast<double>(large) / small;
  taps = static_cast<int>(std::ceil(scale)) + (scale > std::floor(scale) ? 1 : 0);
  first.resize(small);
  share.assign(static_cast<size_t>(taps) * small, 0.0f);
  for (int i = 0; i < small; ++i) {
    const double begin = i * scale, end = std::min(begin + scale, static_cast<double>(large));
    first[i] = static_cast<int>(begin);
    for (int k = 0; k < taps; ++k) {
      const double covered = std::min<double>(first[i] + k + 1, end) - std::max<double>(first[i] + k, begin);
      // OpenCV takes shares below a thousandth for rounding.
      if (covered > 1e-3) share[static_cast<size_t>(taps) * i + k] = static_cast<float>(covered / scale);
    }
  }
}

void ReducedRows::addRow(const float* row, float share) {
  addShare(row, share, large_.width, sum_.data());
}

void ReducedRows::sumAlong(float* out) const {
  const float* share = x_.share.data();
  for (int i = 0; i < small_.width; ++i, share += x_.taps) {
    const float* from = sum_.data() + x_.first[i];
    float sum = 0;
    for (int k = 0; k < x_.taps; ++k) sum += share[k] * from[k];
    out[i] = sum;
  }
}

void EnlargedRows::begin(const cv::Size& small, const cv::Size& large) {
  widened_.begin(2, large.width);  // neighbours do not displace each other
  if (small == small_ && large == large_) return;
  small_ = small;
  large_ = large;
  x_.begin(small.width, large.width);
  y_.begin(small.height, large.height);
  row_.resize(small.width);
  out_.resize(large.width);
}

void EnlargedRows::Axis::begin(int small, int large) {
  first.resize(large);
  second.resize(large);
  fraction.resize(large);
  for (int i = 0; i < large; ++i) {
    const double position = std::clamp((i + 0.5) * small / large - 0.5, 0.0, small - 1.0);
    first[i] = static_cast<int>(position);
    second[i] = std::min(first[i] + 1, small - 1);
    fraction[i] = static_cast<float>(position - first[i]);
  }
}

void EnlargedRows::widen(float* out) const {
  interpolateAlong(row_.data(), x_.first.data(), x_.second.data(), x_.fraction.data(), large_.width, out);
}

const float* EnlargedRows::blend(const float* north, const float* south, float fraction) {
  interpolateAcross(north, south, fraction, large_.width, out_.data());
  return out_.data();
}

}  // namespace all_in_focus::core
