// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/frame_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace all_in_focus::core {
namespace {

constexpr int kTaps = 6;
constexpr int kChannels = 3;

// Where one row or column of the output comes from: pixels first, first + 1, ... and their weights.
struct Taps {
  int first;
  std::array<float, kTaps> weight;
};

// Lanczos kernel: sinc(x) sinc(x / 3), |x| < 3.
double lanczos(double x) {
  if (std::abs(x) < 1e-9) return 1;
  const double a = CV_PI * x;
  return std::sin(a) * std::sin(a / 3) / (a * a / 3);
}

// Taps of every output coordinate u at u' = center + scale (u - center) + shift, weights of sum 1.
std::vector<Taps> tapsOf(int length, double scale, double center, double shift) {
  std::vector<Taps> taps(length);
  for (int u = 0; u < length; ++u) {
    const double from = center + scale * (u - center) + shift;
    // Beyond the border all taps read the border pixel.
    const double inside = std::clamp(from, -3.0, length + 2.0);
    taps[u].first = static_cast<int>(std::floor(inside)) - (kTaps / 2 - 1);
    double sum = 0;
    std::array<double, kTaps> weight;
    for (int k = 0; k < kTaps; ++k) sum += weight[k] = lanczos(inside - (taps[u].first + k));
    for (int k = 0; k < kTaps; ++k) taps[u].weight[k] = static_cast<float>(weight[k] / sum);
  }
  return taps;
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

void warpToReference(const cv::Mat& frame, const Motion& motion, const cv::Point2d& center, cv::Mat& out) {
  if (frame.type() != CV_8UC3) throw std::invalid_argument("warp: the frame must be CV_8UC3");
  if (motion.isIdentity()) return frame.copyTo(out);
  out.create(frame.size(), CV_8UC3);
  const std::vector<Taps> rows = tapsOf(frame.rows, motion.scale, center.y, motion.shift.y);
  const std::vector<Taps> columns = tapsOf(frame.cols, motion.scale, center.x, motion.shift.x);

  // One output row at a time: first down the columns, into a row with room for taps beyond both borders.
  constexpr int kBorder = 3 + kTaps;
  const int values = kChannels * frame.cols;
  std::vector<float> buffer(values + 2 * kChannels * kBorder + 1);
  float* row = buffer.data() + kChannels * kBorder;
  for (int y = 0; y < frame.rows; ++y) {
    std::array<const std::uint8_t*, kTaps> from;
    for (int k = 0; k < kTaps; ++k) from[k] = frame.ptr(std::clamp(rows[y].first + k, 0, frame.rows - 1));
    const std::array<float, kTaps> w = rows[y].weight;
    for (int i = 0; i < values; ++i) {
      row[i] = w[0] * from[0][i] + w[1] * from[1][i] + w[2] * from[2][i] + w[3] * from[3][i] +
               w[4] * from[4][i] + w[5] * from[5][i];
    }
    for (int i = 0; i < kChannels * kBorder; ++i) {
      row[-1 - i] = row[kChannels - 1 - i % kChannels];
      row[values + i] = row[values - kChannels + i % kChannels];
    }
    auto* to = out.ptr<std::uint8_t>(y);
    for (int x = 0; x < frame.cols; ++x, to += kChannels) {
      const float* pixel = row + kChannels * columns[x].first;
      std::array<float, 4> sum{};  // four lanes for three channels
      for (int k = 0; k < kTaps; ++k) {
        for (int c = 0; c < 4; ++c) sum[c] += columns[x].weight[k] * pixel[kChannels * k + c];
      }
      for (int c = 0; c < kChannels; ++c) to[c] = cv::saturate_cast<std::uint8_t>(sum[c]);
    }
  }
}

}  // namespace all_in_focus::core
