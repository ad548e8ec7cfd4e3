// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/sharpness_pyramid.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

// A Gaussian window, px of the level.
struct Window {
  double sigma;
  int radius;
};

constexpr struct SharpnessParameters {
  Window finest_window = {0.85, 2};  // keeps to its side of an edge
  Window coarser_window = {1.4, 4};
  int smallest_side = 12;  // px of the coarsest level
  // The product of this level and all coarser ones counts by its power 3/4: their windows look across thin
  // things. (The power 1/2: gardens +0.1 to 0.3 dB without depth, slope_jitter enlarged five times -1.0.)
  size_t far_level = 2;
  // Factor of the finest level of a resampled frame. Resampling takes away the finest detail, and its errors
  // look like detail. (0.9 gains two thirds as much, 1: clutter_mild -0.38 dB, 0.7: gardens up to -0.5.)
  double resampled = 0.85;
  // Limit of s_l near clipped lights, gray levels, and the finest level that it holds for: at most so many
  // times as wide as the map of the lights. Windows of finer levels are smaller than the discs of lights.
  float most_near_lights = 3;
  double finest_of_lights = 1.5;
  // The floor of a level, gray levels: the sharpness that rounding to 8 bits has, and so many standard
  // deviations of the noise, times a factor for every coarser level. The sharpness of a frame is added to it
  // in quadrature, so that frames count alike where they show only noise. The factor is that of noise which
  // is correlated over pixels (demosaicing, JPEG, enlarging): the finest levels show little of it, but what
  // they show varies widely.
  double rounding = 1.7, deviations = 12, of_finer_level = 0.6;
  // A frame that is sharp anywhere has this modified Laplacian, gray levels above the noise, in its sharpest
  // places at textureLevel(). The eighth power of the least trust is a weight of 1e-9. (All frames trusted:
  // plain with three frames that are sharp nowhere, without depth, -2.8 dB; no scene of the suites changes.)
  double sharp = 4, least_trust = 0.075;
  double texture_width = 640;  // of a picture whose textureLevel() is 1
} kSharpness{};

double floorOf(const NoiseSpectrum& noise, size_t level) {
  return std::pow(kSharpness.of_finer_level, level) *
         (kSharpness.rounding + kSharpness.deviations * noise.deviation());
}

// At n pixels that have neighbours on both sides.
ALL_IN_FOCUS_SIMD void laplacianInside(const float* north, const float* here, const float* south, int n,
                                       float* __restrict out) {
  for (int i = 0; i < n; ++i) {
    const float twice = 2 * here[i];
    out[i] = std::abs(twice - here[i - 1] - here[i + 1]) + std::abs(twice - north[i] - south[i]);
  }
}

// Row y of the modified Laplacian. Beyond its border the picture is continued by its last row or column.
void laplacianRow(const cv::Mat1f& image, int y, float* out) {
  const float *here = image[y], *north = image[std::max(y - 1, 0)],
              *south = image[std::min(y + 1, image.rows - 1)];
  const int last = image.cols - 1;
  if (last > 0) laplacianInside(north + 1, here + 1, south + 1, last - 1, out + 1);
  for (const int x : {0, last}) {
    const float across = 2 * here[x] - north[x] - south[x];
    const float along = 2 * here[x] - here[std::max(x - 1, 0)] - here[std::min(x + 1, last)];
    out[x] = std::abs(along) + std::abs(across);
  }
}

// The modified Laplacian of some rows in a window, gray levels. out: CV_32FC1, of their size.
void smoothedLaplacian(const cv::Mat& image, const cv::Range& rows, const Window& window,
                       SharpnessPyramid::Buffers& buffers, cv::Mat out) {
  const cv::Range all(std::max(rows.start - window.radius, 0),
                      std::min(rows.end + window.radius, image.rows));
  const cv::Range with_neighbours(std::max(all.start - 1, 0), std::min(all.end + 1, image.rows));
  image.rowRange(with_neighbours).convertTo(buffers.pixels, CV_32F);
  buffers.laplacian.create(all.size(), image.cols);
  for (int y = all.start; y < all.end; ++y)
    laplacianRow(buffers.pixels, y - with_neighbours.start, buffers.laplacian[y - all.start]);
  // OpenCV sees the rows around these, too, and mirrors the picture where there are none.
  const int side = 2 * window.radius + 1;
  cv::GaussianBlur(buffers.laplacian.rowRange(rows.start - all.start, rows.end - all.start), out,
                   {side, side}, window.sigma, window.sigma, cv::BORDER_REFLECT_101);
}

ALL_IN_FOCUS_SIMD void mean(const float* a, const float* b, int n, float* __restrict out) {
  for (int i = 0; i < n; ++i) out[i] = 0.5f * (a[i] + b[i]);
}

// The sum in quadrature: where s is far below the floor, how much it varies does not matter.
inline float aboveFloor(float s, float squared_floor) {
  return std::sqrt(s * s + squared_floor);
}

// aboveFloor() times the coarser product, of which two pixels make four: 0, 0 | 1, 1, 1 | 2, ...
ALL_IN_FOCUS_SIMD void multiply(const float* coarser, float contrast, float squared_floor, int pairs,
                                float* __restrict s) {
  for (int i = 0; i < pairs; ++i) {
    s[2 * i] = aboveFloor(contrast * s[2 * i], squared_floor) * coarser[i];
    s[2 * i + 1] =
        aboveFloor(contrast * s[2 * i + 1], squared_floor) * (0.5f * (coarser[i] + coarser[i + 1]));
  }
}

ALL_IN_FOCUS_SIMD void raise(float contrast, float squared_floor, int n, float* s) {
  for (int i = 0; i < n; ++i) s[i] = aboveFloor(contrast * s[i], squared_floor);
}

// Row y of a level: its smoothed Laplacian `s` becomes the product. coarser: the product of the next level,
// whose pixel i lies on pixel 2 i of this one; it is interpolated linearly. buffer: for one of its rows.
void multiplyRow(const cv::Mat& coarser, int y, float contrast, float floor, int n,
                 std::vector<float>& buffer, float* s) {
  const float squared_floor = floor * floor;
  if (coarser.empty()) return raise(contrast, squared_floor, n, s);
  const float* north = coarser.ptr<float>(y / 2);
  const float* south = coarser.ptr<float>(std::min((y + 1) / 2, coarser.rows - 1));
  buffer.resize(coarser.cols + 1);
  mean(north, south, coarser.cols, buffer.data());
  buffer[coarser.cols] = buffer[coarser.cols - 1];
  multiply(buffer.data(), contrast, squared_floor, n / 2, s);
  if (n % 2 == 1) s[n - 1] = aboveFloor(contrast * s[n - 1], squared_floor) * buffer[n / 2];
}

}  // namespace

void SharpnessPyramid::begin(const cv::Mat& gray, const Gauge& gauge) {
  if (gray.type() != CV_8UC1 || gray.empty()) {
    throw std::invalid_argument("sharpness: the image must be CV_8UC1 and not empty");
  }
  gray_ = gray;
  contrast_ = static_cast<float>(gauge.contrast);
  finest_contrast_ =
      static_cast<float>(gauge.resampled ? kSharpness.resampled * gauge.contrast : gauge.contrast);
  trust_ = 1;
  const int side = std::min(gray.cols, gray.rows);
  for (count_ = 1; gauge.scales && side >> count_ >= kSharpness.smallest_side;) ++count_;
  if (levels_.size() < count_) levels_.resize(count_);
  for (size_t l = 0; l < count_; ++l) {
    levels_[l].floor = static_cast<float>(floorOf(gauge.noise, l));
  }
  texture_level_ = std::min(count_ - 1, textureLevel(gray.cols));
  texture_.release();
  if (count_ == 1) return;
  for (size_t l = 1; l < count_; ++l) {
    Level& level = levels_[l];
    level.image = nextLevel(l == 1 ? gray : levels_[l - 1].image);
    if (level.image.cols > kSharpness.finest_of_lights * gauge.lights.cols)
      level.lights.release();
    else
      cv::resize(gauge.lights, level.lights, level.image.size(), 0, 0, cv::INTER_NEAREST);
  }
  for (size_t l = count_ - 1; l > 0; --l) {
    computeProduct(l);
    if (gauge.trust && l == texture_level_) trust_ = trust(gauge.noise.sharpness(l));
    cv::Mat& product = levels_[l].product;
    const bool predicted = product.size() == gauge.predicted.size();
    if (predicted) cv::sqrt(product, root_);
    if (l == kSharpness.far_level) {
      cv::sqrt(product, far_root_);
      cv::sqrt(far_root_, product);
      cv::multiply(far_root_, product, product);
    }
    if (predicted) root_.copyTo(product, gauge.predicted);
  }
}

cv::Size SharpnessPyramid::levelSize(const cv::Size& size, size_t level) {
  const int side = std::min(size.width, size.height);
  cv::Size of_level = size;
  for (size_t l = 1; l <= level && side >> l >= kSharpness.smallest_side; ++l)
    of_level = {(of_level.width + 1) / 2, (of_level.height + 1) / 2};
  return of_level;
}

std::size_t SharpnessPyramid::textureLevel(int width) {
  return 1 + static_cast<size_t>(std::max(0.0, std::round(std::log2(width / kSharpness.texture_width))));
}

// noise: mean modified Laplacian of the noise of the level of texture_.
float SharpnessPyramid::trust(double noise) const {
  const double mean =
      cv::norm(texture_.mul(texture_), cv::NORM_L2SQR) / static_cast<double>(texture_.total());
  const double above_noise = std::pow(std::max(mean - std::pow(kNoiseMargin * noise, 4), 0.0), 0.25);
  return static_cast<float>(
      std::clamp(above_noise / (kSharpness.sharp + noise), kSharpness.least_trust, 1.0));
}

void SharpnessPyramid::computeProduct(size_t level) {
  const cv::Mat &image = levels_[level].image, &lights = levels_[level].lights;
  const cv::Mat coarser = level + 1 < count_ ? levels_[level + 1].product : cv::Mat();
  cv::Mat& product = levels_[level].product;
  product.create(image.size(), CV_32FC1);
  if (level == texture_level_) texture_.create(image.size(), CV_32FC1);
  const RowStrips strips({0, image.rows}, stripCount(image.rows));
  if (static_cast<int>(strips_.size()) < strips.count()) strips_.resize(strips.count());
  strips.forEach([&](const cv::Range& strip, int i) {
    for (cv::Range rows(strip.start, 0); rows.start < strip.end; rows.start = rows.end) {
      rows.end = std::min(rows.start + kBlockRows, strip.end);
      cv::Mat out = product.rowRange(rows);
      smoothedLaplacian(image, rows, kSharpness.coarser_window, strips_[i], out);
      if (level == texture_level_) out.convertTo(texture_.rowRange(rows), -1, contrast_);
      if (!lights.empty())
        cv::Mat(cv::min(out, kSharpness.most_near_lights / contrast_)).copyTo(out, lights.rowRange(rows));
      for (int y = rows.start; y < rows.end; ++y)
        multiplyRow(coarser, y, contrast_, levels_[level].floor, image.cols, strips_[i].coarser,
                    product.ptr<float>(y));
    }
  });
}

cv::Mat1f& SharpnessPyramid::compute(const cv::Range& rows, Buffers& buffers) const {
  buffers.sharpness.create(rows.size(), gray_.cols);
  smoothedLaplacian(gray_, rows, kSharpness.finest_window, buffers, buffers.sharpness);
  const cv::Mat coarser = count_ > 1 ? levels_[1].product : cv::Mat();
  for (int y = rows.start; y < rows.end; ++y) {
    multiplyRow(coarser, y, trust_ * finest_contrast_, trust_ * levels_[0].floor, gray_.cols, buffers.coarser,
                buffers.sharpness[y - rows.start]);
  }
  return buffers.sharpness;
}

}  // namespace all_in_focus::core
