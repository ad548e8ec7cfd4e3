// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/defocus_prediction.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace all_in_focus::core {
namespace {

constexpr double kLaplacian = 36;  // of a textured picture, gray levels; results hardly depend on it
constexpr double kHoleError = 10;  // gray levels; added for filled depth, which may be any surface nearby
constexpr double kUnknownFocusError = 10;  // gray levels: neither sharp nor much blurred

constexpr int kLevels = 1024;  // of closeness, for the table
constexpr int kUnknown = kLevels;
constexpr double kSensorColumns = 640;
constexpr double kPixelError = 0.5;  // px that no registration can better
constexpr float kLeastKnown = 1e-3f;

}  // namespace

void DefocusPrediction::begin(const cv::Mat& depth, const cv::Mat& measured, const cv::Size& size,
                              const Optics& optics, double pixel_pitch_mm) {
  if (depth.type() != CV_16UC1 || depth.empty()) {
    throw std::invalid_argument("defocus: depth must be CV_16UC1 and not empty");
  }
  if (!measured.empty() && (measured.type() != CV_16UC1 || measured.size() != depth.size())) {
    throw std::invalid_argument("defocus: measured depth must be CV_16UC1 and of the size of the filled");
  }
  if (!(pixel_pitch_mm > 0)) throw std::invalid_argument("defocus: the pixel pitch must be positive");
  validate(optics);
  optics_ = optics;
  pixel_pitch_mm_ = pixel_pitch_mm;
  size_ = size;

  const double edge_error = (config_.edge_uncertainty ? config_.edge_error_px : kPixelError) *
                            std::max(1.0, size.width / kSensorColumns);
  const int cell = std::max(1, static_cast<int>(edge_error));
  edge_error_px_ = edge_error / cell;
  const cv::Size grid((size.width + cell - 1) / cell, (size.height + cell - 1) / cell);

  // Depth at the middle of each cell.
  cv::Mat coarse(grid, CV_16UC1);
  cv::Mat doubt(grid, CV_32FC1);
  int nearest = std::numeric_limits<int>::max(), farthest = 0;
  for (int v = 0; v < grid.height; ++v) {
    const int y = static_cast<int>((v + 0.5) * depth.rows / grid.height);
    auto* to = coarse.ptr<std::uint16_t>(v);
    float* in_doubt = doubt.ptr<float>(v);
    for (int u = 0; u < grid.width; ++u) {
      const int x = static_cast<int>((u + 0.5) * depth.cols / grid.width);
      to[u] = depth.at<std::uint16_t>(y, x);
      if (to[u] <= optics.focal_length_mm) to[u] = 0;  // no lens can be focused there
      const bool filled = !measured.empty() && measured.at<std::uint16_t>(y, x) == 0;
      in_doubt[u] = config_.hole_doubt && filled && to[u] > 0 ? 1.0f : 0.0f;
      if (to[u] > 0) nearest = std::min<int>(nearest, to[u]);
      farthest = std::max<int>(farthest, to[u]);
    }
  }
  least_ = farthest > 0 ? 1.0 / farthest : 0;
  level_step_ = farthest > nearest ? (1.0 / nearest - least_) / (kLevels - 1) : 0;

  level_.create(grid, CV_16UC1);
  known_.create(grid, CV_32FC1);
  for (int v = 0; v < grid.height; ++v) {
    const auto* from = coarse.ptr<std::uint16_t>(v);
    auto* level = level_.ptr<std::uint16_t>(v);
    float* known = known_.ptr<float>(v);
    for (int u = 0; u < grid.width; ++u) {
      const double steps = from[u] > 0 && level_step_ > 0 ? (1.0 / from[u] - least_) / level_step_ : 0;
      level[u] = static_cast<std::uint16_t>(from[u] > 0 ? std::lround(steps) : kUnknown);
      known[u] = from[u] > 0 ? 1.0f : 0.0f;
    }
  }
  cv::GaussianBlur(doubt, constant_, cv::Size(), edge_error_px_);
  constant_ *= kHoleError * kHoleError;
  cv::GaussianBlur(known_, known_, cv::Size(), edge_error_px_);
  for (int v = 0; v < grid.height; ++v) {
    float* known = known_.ptr<float>(v);
    for (int u = 0; u < grid.width; ++u) known[u] = known[u] > kLeastKnown ? 1 / known[u] : 0;
  }
}

void DefocusPrediction::compute(double focus_mm, cv::Mat& squared_error) {
  computeCoarse(focus_mm, coarse_);
  cv::resize(coarse_, squared_error, size_, 0, 0, cv::INTER_LINEAR);
}

void DefocusPrediction::computeCoarse(double focus_mm, cv::Mat& squared_error) {
  if (focus_mm <= optics_.focal_length_mm) {
    throw std::invalid_argument(
        cv::format("defocus: focus distance %g mm is not beyond the focal length, %g mm", focus_mm,
                   optics_.focal_length_mm));
  }
  error_of_level_.assign(kLevels + 1, 0.0f);
  for (int i = 0; i < kLevels && least_ > 0; ++i) {
    const double b = blurCircle(optics_, 1 / (least_ + i * level_step_), focus_mm) / pixel_pitch_mm_;
    const double error = std::isnan(focus_mm) ? kUnknownFocusError : kLaplacian / 32 * b * b;
    error_of_level_[i] = static_cast<float>(error * error);
  }
  error_.create(level_.size(), CV_32FC1);
  for (int v = 0; v < level_.rows; ++v) {
    const auto* level = level_.ptr<std::uint16_t>(v);
    float* error = error_.ptr<float>(v);
    for (int u = 0; u < level_.cols; ++u) error[u] = error_of_level_[level[u]];
  }
  cv::GaussianBlur(error_, squared_error, cv::Size(), edge_error_px_);
  cv::add(squared_error, constant_, squared_error);
  // Mean over what is known; 0 for all frames alike where nothing is.
  cv::multiply(squared_error, known_, squared_error);
}

}  // namespace all_in_focus::core
