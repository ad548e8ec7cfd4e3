// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/defocus_prediction.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "fusion/sharpness_pyramid.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr double kLaplacian = 36;          // of a textured picture, gray levels; results hardly depend on it
constexpr double kLeastLaplacian = 3;      // light of blurred things may lie on the barest surface
constexpr double kPeak = 2;                // of the Laplacian, in units of its mean over a window
constexpr double kMostLaplacians = 4;      // by which blur changes a picture; a wider disc changes it no more
constexpr double kNoiseMargin = 1.25;      // frames differ in their noise, and places in a frame
constexpr double kUnknownFocusError = 10;  // gray levels: neither sharp nor much blurred

constexpr double kSensorColumns = 640;
constexpr double kPixelError = 0.5;  // px that no registration can better
constexpr float kLeastKnown = 1e-3f;
constexpr double kCellOfError = 1.5;  // side of a cell, of the deviation of edges

// Squared error of a textured picture, by inverse depth, 0 = unknown. blur: the disc's diameter in units of
// the texture's pixels, by inverse depth from that of the focus.
ALL_IN_FOCUS_SIMD void predict(const float* inverse_depth, float blur, float focus, int n,
                               float* squared_error) {
  for (int i = 0; i < n; ++i) {
    const float b = blur * (inverse_depth[i] - focus);
    const float error =
        static_cast<float>(kLaplacian) * std::min(b * b / 32, static_cast<float>(kMostLaplacians));
    squared_error[i] = inverse_depth[i] > 0 ? error * error : 0;
  }
}

// Scales squared_error from that of a textured picture to that of one with the modified Laplacian l, a mean
// over a window.
ALL_IN_FOCUS_SIMD void weigh(const float* l, int n, float* squared_error) {
  for (int i = 0; i < n; ++i) {
    const float laplacian = static_cast<float>(kLeastLaplacian) + static_cast<float>(kPeak) * l[i];
    const float share = std::min(laplacian / static_cast<float>(kLaplacian), 1.0f);
    squared_error[i] *= share * share;
  }
}

}  // namespace

void DefocusPrediction::begin(const cv::Mat& depth, const cv::Size& size, const Optics& optics,
                              double pixel_pitch_mm) {
  if (depth.type() != CV_16UC1 || depth.empty()) {
    throw std::invalid_argument("defocus: depth must be CV_16UC1 and not empty");
  }
  if (!(pixel_pitch_mm > 0)) throw std::invalid_argument("defocus: the pixel pitch must be positive");
  validate(optics);
  optics_ = optics;
  pixel_pitch_mm_ = pixel_pitch_mm;

  const double columns = std::max(1.0, size.width / kSensorColumns);
  texture_level_ = SharpnessPyramid::textureLevel(size.width);
  const double edge_error = (config_.edge_uncertainty ? config_.edge_error_px : kPixelError) * columns;
  const int cell = std::max(1, static_cast<int>(kCellOfError * edge_error));
  edge_error_px_ = edge_error / cell;
  const cv::Size grid((size.width + cell - 1) / cell, (size.height + cell - 1) / cell);

  // Depth at the middle of each cell.
  laplacian_.release();
  inverse_depth_.create(grid);
  for (int v = 0; v < grid.height; ++v) {
    const auto* row = depth.ptr<std::uint16_t>(static_cast<int>((v + 0.5) * depth.rows / grid.height));
    for (int u = 0; u < grid.width; ++u) {
      const int mm = row[static_cast<int>((u + 0.5) * depth.cols / grid.width)];
      const bool possible = mm > optics.focal_length_mm;  // no lens can be focused nearer
      inverse_depth_(v, u) = possible ? 1.0f / static_cast<float>(mm) : 0;
    }
  }
  cv::Mat(inverse_depth_ > 0).convertTo(known_, CV_32F, 1 / 255.0);
  cv::GaussianBlur(known_, known_, cv::Size(), edge_error_px_);
  for (int v = 0; v < grid.height; ++v) {
    float* known = known_.ptr<float>(v);
    for (int u = 0; u < grid.width; ++u) known[u] = known[u] > kLeastKnown ? 1 / known[u] : 0;
  }
}

void DefocusPrediction::addTexture(const cv::Mat& sharpness, double noise) {
  if (sharpness.type() != CV_32FC1 || sharpness.empty()) {
    throw std::invalid_argument("defocus: texture must be CV_32FC1 and not empty");
  }
  // The largest of a cell and its neighbours, because blur brings their light here.
  cv::resize(sharpness, texture_, inverse_depth_.size(), 0, 0, cv::INTER_AREA);
  cv::dilate(texture_, texture_, cv::Mat());
  cv::subtract(texture_, kNoiseMargin * noise, texture_);
  if (laplacian_.empty()) laplacian_ = cv::Mat(inverse_depth_.size(), CV_32FC1, cv::Scalar(0));
  cv::max(laplacian_, texture_, laplacian_);
}

cv::Mat DefocusPrediction::known(const cv::Size& size) const {
  cv::Mat known;
  cv::resize(known_ > 0, known, size, 0, 0, cv::INTER_NEAREST);
  return known;
}

void DefocusPrediction::compute(double focus_mm, cv::Mat& squared_error) {
  if (focus_mm <= optics_.focal_length_mm) {
    throw std::invalid_argument(
        cv::format("defocus: focus distance %g mm is not beyond the focal length, %g mm", focus_mm,
                   optics_.focal_length_mm));
  }
  // The texture is that of a coarser level: its pixels are the unit of the blur circle.
  const double unit_mm = pixel_pitch_mm_ * std::pow(2.0, static_cast<double>(texture_level_) - 1);
  const bool known = !std::isnan(focus_mm);
  const double blur = optics_.focal_length_mm / optics_.aperture * imageDistance(optics_, focus_mm) / unit_mm;
  error_.create(inverse_depth_.size());
  error_.setTo(0);
  if (!known) error_.setTo(kUnknownFocusError * kUnknownFocusError, inverse_depth_ > 0);
  for (int v = 0; known && v < error_.rows; ++v)
    predict(inverse_depth_[v], static_cast<float>(blur), static_cast<float>(1 / focus_mm), error_.cols,
            error_[v]);
  cv::GaussianBlur(error_, squared_error, cv::Size(), edge_error_px_);
  // The mean over known depth. Where there is none, all frames get 0 alike.
  cv::multiply(squared_error, known_, squared_error);
  if (laplacian_.empty() || !known) return;
  for (int v = 0; v < squared_error.rows; ++v)
    weigh(laplacian_.ptr<float>(v), squared_error.cols, squared_error.ptr<float>(v));
}

}  // namespace all_in_focus::core
