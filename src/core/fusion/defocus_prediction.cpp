// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/defocus_prediction.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "fusion/sharpness_pyramid.hpp"
#include "optics/disc_blur.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr struct PredictionParameters {
  // Gray levels. Results hardly depend on the first one.
  float laplacian = 36;    // of a textured picture
  double most_hidden = 3;  // texture that noise may hide: as much as its own Laplacian, at most this
  // Of what a disc covers, in gray levels. (144: restored motorcycle_60 -0.14 dB.)
  float glow = 72;
  float contrast = 3;      // of its difference from that (0: gold pins before a board -0.6 to -1.7 dB)
  double hole_error = 10;  // of filled depth, which may be any surface nearby
  float unknown_focus_error = 10;  // neither sharp nor much blurred
  float peak = 2;                  // of the Laplacian, in units of its mean over a window
  float most_laplacians = 4;       // by which blur changes a picture; a wider disc changes it no more
  // How far the edges of registered depth lie from those of the picture: standard deviation, px of a picture
  // as wide as a depth sensor's own, more in a wider one. (0: -0.15 dB.)
  double edge_error = 2, sensor_columns = 640;
  double cell = 1.5;          // side of a cell of the grid, in that deviation
  float least_known = 1e-3f;  // share of known depth about a cell
} kPrediction{};

constexpr int kSlabs = 8;  // of inverse depth (16: plain_35mm +0.05 dB)
// Light of a slab lies over those behind the next two: a slope lies in slabs that are neighbours (1: restored
// slope -0.16 dB).
constexpr std::size_t kFirstBehind = 3;

// The squared error of a textured picture by its blur; 0 where depth is unknown.
ALL_IN_FOCUS_SIMD void blurError(const float* inverse_depth, FrameBlur blur, std::size_t n,
                                 float* __restrict squared_error) {
  for (std::size_t i = 0; i < n; ++i) {
    const float b = 2 * blur.radius(inverse_depth[i]);
    const float error = kPrediction.laplacian * std::min(b * b / 32, kPrediction.most_laplacians);
    squared_error[i] = inverse_depth[i] == 0 ? 0 : error * error;
  }
}

// Scales squared_error from that of a textured picture to that of one with the modified Laplacian l, a mean
// over a window, and one that noise hides.
ALL_IN_FOCUS_SIMD void weigh(const float* l, float hidden, std::size_t n, float* squared_error) {
  for (std::size_t i = 0; i < n; ++i) {
    const float laplacian = hidden + kPrediction.peak * l[i];
    const float share = std::min(laplacian / kPrediction.laplacian, 1.0f);
    squared_error[i] *= share * share;
  }
}

// squared_error = (72 c + 3 |light - c picture|)^2. nearer: 255 c and light of what covers the picture.
ALL_IN_FOCUS_SIMD void glow(const std::uint8_t* nearer, const std::uint8_t* picture, std::size_t n,
                            float* squared_error) {
  for (std::size_t i = 0; i < n; ++i) {
    const float share = nearer[2 * i] / 255.0f;
    const float difference = std::abs(nearer[2 * i + 1] - share * picture[i]);
    const float error = kPrediction.glow * share + kPrediction.contrast * difference;
    squared_error[i] = error * error;
  }
}

}  // namespace

void DefocusPrediction::begin(const cv::Mat& depth, const cv::Mat& measured, const cv::Size& size,
                              const Optics& optics, double pixel_pitch_mm) {
  optics_ = optics;
  pixel_pitch_mm_ = pixel_pitch_mm;

  const double columns = std::max(1.0, size.width / kPrediction.sensor_columns);
  texture_level_ = SharpnessPyramid::textureLevel(size.width);
  const double edge_error = kPrediction.edge_error * columns;
  cell_ = std::max(1, static_cast<int>(kPrediction.cell * edge_error));
  edge_error_px_ = edge_error / cell_;
  const int side = 2 * cvRound(3 * edge_error_px_) + 1;
  window_ = {side, side};
  const cv::Size grid((size.width + cell_ - 1) / cell_, (size.height + cell_ - 1) / cell_);

  // At the middle of each cell.
  inverse_depth_ = cv::Mat1f::zeros(grid);
  cv::Mat1f doubt(grid, 0.0f);
  for (int v = 0; v < grid.height; ++v) {
    const int y = static_cast<int>((v + 0.5) * depth.rows / grid.height);
    for (int u = 0; u < grid.width; ++u) {
      const int x = static_cast<int>((u + 0.5) * depth.cols / grid.width);
      const auto mm = static_cast<float>(depth.at<std::uint16_t>(y, x));
      if (mm <= optics.focal_length_mm) continue;  // no lens can be focused there
      inverse_depth_(v, u) = 1 / mm;
      doubt(v, u) = !measured.empty() && measured.at<std::uint16_t>(y, x) == 0 ? 1.0f : 0.0f;
    }
  }
  const cv::Mat known = inverse_depth_ > 0;
  laplacian_.release();
  hidden_ = 0;

  slabs_.clear();
  double least = 0, most = 0;
  cv::minMaxLoc(inverse_depth_, &least, &most, nullptr, nullptr, known);
  for (int i = 0; i < kSlabs && least < most; ++i) {
    const double near = most - i * (most - least) / kSlabs, far = most - (i + 1) * (most - least) / kSlabs;
    cv::Mat cells;
    cv::inRange(inverse_depth_, i + 1 < kSlabs ? far : least, i > 0 ? near : most, cells);
    slabs_.push_back({2 / (near + far), cells, cv::Mat()});
  }
  setPicture(cv::Mat::zeros(grid, CV_8UC1));

  cv::GaussianBlur(doubt, constant_, window_, edge_error_px_);
  constant_ *= kPrediction.hole_error * kPrediction.hole_error;
  known.convertTo(per_known_, CV_32F, 1.0 / 255);
  cv::GaussianBlur(per_known_, per_known_, window_, edge_error_px_);
  for (float& share : per_known_) share = share > kPrediction.least_known ? 1 / share : 0;
}

void DefocusPrediction::addTexture(const cv::Mat& sharpness, double noise) {
  // The largest of a cell and its neighbours, because blur brings their light here.
  cv::Mat texture;
  cv::resize(sharpness, texture, inverse_depth_.size(), 0, 0, cv::INTER_LINEAR);  // it is smooth already
  cv::dilate(texture, texture, cv::Mat());
  texture -= kNoiseMargin * noise;
  if (laplacian_.empty()) laplacian_ = cv::Mat1f::zeros(texture.size());
  cv::max(laplacian_, texture, laplacian_);
  hidden_ = std::max(hidden_, static_cast<float>(std::min(noise, kPrediction.most_hidden)));
}

void DefocusPrediction::setPicture(const cv::Mat& gray) {
  cv::resize(gray, picture_, inverse_depth_.size(), 0, 0, cv::INTER_AREA);
  for (Slab& slab : slabs_) cv::merge(std::vector<cv::Mat>{slab.cells, picture_ & slab.cells}, slab.light);
}

void DefocusPrediction::compute(double focus_mm, cv::Mat& squared_error) {
  // The texture is that of a coarser level: its pixels are the unit of the blur circle.
  const double unit_mm = pixel_pitch_mm_ * std::pow(2.0, static_cast<double>(texture_level_) - 1);
  const FrameBlur blur = frameBlur(optics_, unit_mm, 1 / focus_mm);
  error_.create(inverse_depth_.size());
  blurError(inverse_depth_[0], blur, error_.total(), error_[0]);
  if (std::isnan(focus_mm))
    error_.setTo(kPrediction.unknown_focus_error * kPrediction.unknown_focus_error, inverse_depth_ > 0);
  cv::GaussianBlur(error_, squared_error, window_, edge_error_px_);
  cv::add(squared_error, constant_, squared_error);
  // The mean over known depth. Where there is none, all frames get 0 alike.
  cv::multiply(squared_error, per_known_, squared_error);
  if (std::isnan(focus_mm)) return;
  if (!laplacian_.empty()) weigh(laplacian_[0], hidden_, squared_error.total(), squared_error.ptr<float>());
  addGlow(focus_mm, squared_error);
}

void DefocusPrediction::addGlow(double focus_mm, cv::Mat& squared_error) {
  // Discs of the slabs so far: share that they cover and their light; nearer_light: of those nearer than a
  // cell.
  cv::Mat covered = cv::Mat::zeros(inverse_depth_.size(), CV_8UC2);
  cv::Mat nearer_light = cv::Mat::zeros(inverse_depth_.size(), CV_8UC2), disc;
  for (std::size_t i = kFirstBehind; i < slabs_.size(); ++i) {
    const Slab& nearer = slabs_[i - kFirstBehind];
    // A disc wider than the picture, by wrong numbers maybe, would only take longer.
    const double width = std::min(blurCircle(optics_, nearer.depth_mm, focus_mm) / (pixel_pitch_mm_ * cell_),
                                  static_cast<double>(inverse_depth_.cols));
    const int side = 2 * cvRound(width / 2) + 1;  // cells that a disc reaches
    if (side > 1 && cv::countNonZero(nearer.cells) > 0) {
      cv::GaussianBlur(nearer.light, disc, {side, side}, width / 4);
      covered += disc;
    }
    covered.copyTo(nearer_light, slabs_[i].cells);
  }
  glow(nearer_light.ptr(), picture_.ptr(), picture_.total(), error_[0]);
  cv::GaussianBlur(error_, error_, window_, edge_error_px_);
  cv::add(squared_error, error_, squared_error);
}

}  // namespace all_in_focus::core
