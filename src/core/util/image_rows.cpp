// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "util/image_rows.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

using Window = GaussianRows::Window;
using Taps = GaussianRows::Taps;

template <int kRadius>
inline void convolveBy(const Taps& taps, const Window& w, int n, float* __restrict out) {
  for (int i = 0; i < n; ++i) {
    float sum = w[0] * taps[kRadius][i];
    for (int k = 1; k <= kRadius; ++k) sum += w[k] * (taps[kRadius - k][i] + taps[kRadius + k][i]);
    out[i] = sum;
  }
}

ALL_IN_FOCUS_SIMD void convolve7(const Taps& taps, const Window& w, int n, float* __restrict out) {
  convolveBy<3>(taps, w, n, out);
}

ALL_IN_FOCUS_SIMD void convolve11(const Taps& taps, const Window& w, int n, float* __restrict out) {
  convolveBy<5>(taps, w, n, out);
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

ALL_IN_FOCUS_SIMD void threeTimes(const std::int16_t* values, int n, std::int16_t* __restrict out) {
  for (int i = 0; i < n; ++i) out[3 * i] = out[3 * i + 1] = out[3 * i + 2] = values[i];
}

void downsample(const cv::Mat& image, cv::Mat& level) {
  constexpr int kRows = 16;
  if (image.depth() != CV_8U) return cv::pyrDown(image, level);
  level.create((image.rows + 1) / 2, (image.cols + 1) / 2, CV_16UC1);
  RowStrips({0, level.rows}, stripCount(level.rows)).forEach([&](const cv::Range& strip, int) {
    cv::Mat units, downsampled;
    for (int y = strip.start; y < strip.end; y += kRows) {
      const cv::Range rows(y, std::min(y + kRows, strip.end));
      // A row is made of those from two above to two below twice its number.
      const int top = std::max(2 * rows.start - 2, 0), bottom = std::min(2 * rows.end + 1, image.rows);
      image.rowRange(top, bottom).convertTo(units, CV_16U, kGrayUnit);
      cv::pyrDown(units, downsampled);
      downsampled.rowRange(rows.start - top / 2, rows.end - top / 2).copyTo(level.rowRange(rows));
    }
  });
}

void GaussianRows::begin(const cv::Size& size, double sigma) {
  constexpr double kNegligible = 1e-4;
  const auto weight = [&](int k) { return std::exp(-0.5 * k * k / (sigma * sigma)); };
  radius_ = weight(4) < kNegligible ? 3 : kMostRadius;
  double sum = weight(0);
  for (int k = 1; k <= radius_; ++k) sum += 2 * weight(k);
  for (int k = 0; k <= radius_; ++k) window_[k] = static_cast<float>(weight(k) / sum);
  size_ = size;
  horizontal_.begin(2 * radius_ + 1, size.width);
  padded_.resize(size.width + 2 * radius_);
}

void GaussianRows::convolvePadded(float* out) {
  float* row = padded_.data() + radius_;
  for (int k = 1; k <= radius_; ++k) {
    const int end = size_.width - 1 + k;
    row[-k] = row[cv::borderInterpolate(-k, size_.width, cv::BORDER_REFLECT_101)];
    row[end] = row[cv::borderInterpolate(end, size_.width, cv::BORDER_REFLECT_101)];
  }
  Taps taps;
  for (int k = -radius_; k <= radius_; ++k) taps[k + radius_] = row + k;
  convolve(taps, out);
}

void GaussianRows::convolve(const Taps& taps, float* out) const {
  radius_ == 3 ? convolve7(taps, window_, size_.width, out) : convolve11(taps, window_, size_.width, out);
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
