// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "util/image_rows.hpp"

#include <algorithm>
#include <cmath>

#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kRadius = GaussianRows::kRadius;
using Window = GaussianRows::Window;

ALL_IN_FOCUS_SIMD void convolveRow(const float* row, const Window& w, int n, float* __restrict out) {
  for (int i = 0; i < n; ++i) {
    const float* p = row + i;
    out[i] = w[0] * p[0] + w[1] * (p[-1] + p[1]) + w[2] * (p[-2] + p[2]) + w[3] * (p[-3] + p[3]) +
             w[4] * (p[-4] + p[4]) + w[5] * (p[-5] + p[5]);
  }
}

ALL_IN_FOCUS_SIMD void convolveRows(const std::array<const float*, 2 * kRadius + 1>& rows, const Window& w,
                                    int n, float* __restrict out) {
  const float *n5 = rows[0], *n4 = rows[1], *n3 = rows[2], *n2 = rows[3], *n1 = rows[4], *here = rows[5];
  const float *s1 = rows[6], *s2 = rows[7], *s3 = rows[8], *s4 = rows[9], *s5 = rows[10];
  for (int i = 0; i < n; ++i) {
    out[i] = w[0] * here[i] + w[1] * (n1[i] + s1[i]) + w[2] * (n2[i] + s2[i]) + w[3] * (n3[i] + s3[i]) +
             w[4] * (n4[i] + s4[i]) + w[5] * (n5[i] + s5[i]);
  }
}

ALL_IN_FOCUS_SIMD void interpolateRow(const float* from, const int* first, const int* second,
                                      const float* fraction, int n, float* __restrict to) {
  for (int i = 0; i < n; ++i) to[i] = from[first[i]] * (1 - fraction[i]) + from[second[i]] * fraction[i];
}

ALL_IN_FOCUS_SIMD void interpolateRows(const float* above, const float* below, float fraction, int n,
                                       float* __restrict to) {
  for (int i = 0; i < n; ++i) to[i] = above[i] * (1 - fraction) + below[i] * fraction;
}

}  // namespace

ALL_IN_FOCUS_SIMD void threeTimes(const float* values, int n, float* __restrict out) {
  for (int i = 0; i < n; ++i) out[3 * i] = out[3 * i + 1] = out[3 * i + 2] = values[i];
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
  horizontal_.begin(2 * kRadius + 1, size.width);
  padded_.resize(size.width + 2 * kRadius);
}

void GaussianRows::convolvePadded(float* out) {
  float* row = padded_.data() + kRadius;
  for (int k = 1; k <= kRadius; ++k) {
    const int end = size_.width - 1 + k;
    row[-k] = row[cv::borderInterpolate(-k, size_.width, cv::BORDER_REFLECT_101)];
    row[end] = row[cv::borderInterpolate(end, size_.width, cv::BORDER_REFLECT_101)];
  }
  convolveRow(row, window_, size_.width, out);
}

void GaussianRows::convolveVertically(const std::array<const float*, 2 * kRadius + 1>& rows,
                                      float* out) const {
  convolveRows(rows, window_, size_.width, out);
}

void UpsampledRows::begin(const cv::Size& input, const cv::Size& output) {
  horizontal_.begin(2, output.width);  // consecutive rows lie in different lines
  if (input == input_ && output == output_) return;
  input_ = input;
  output_ = output;
  x_.begin(input.width, output.width);
  y_.begin(input.height, output.height);
  out_.resize(output.width);
}

void UpsampledRows::Axis::begin(int input, int output) {
  first.resize(output);
  second.resize(output);
  fraction.resize(output);
  for (int i = 0; i < output; ++i) {
    const double position = std::clamp((i + 0.5) * input / output - 0.5, 0.0, input - 1.0);
    first[i] = static_cast<int>(position);
    second[i] = std::min(first[i] + 1, input - 1);
    fraction[i] = static_cast<float>(position - first[i]);
  }
}

const float* UpsampledRows::row(int y, const cv::Mat& image) {
  const auto horizontal = [&](int v, float* out) {
    interpolateRow(image.ptr<float>(v), x_.first.data(), x_.second.data(), x_.fraction.data(), output_.width,
                   out);
  };
  const float* above = horizontal_.row(y_.first[y], horizontal);
  const float* below = horizontal_.row(y_.second[y], horizontal);
  interpolateRows(above, below, y_.fraction[y], output_.width, out_.data());
  return out_.data();
}

}  // namespace all_in_focus::core
