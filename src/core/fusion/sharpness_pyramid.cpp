// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/sharpness_pyramid.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

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
  Window coarser_window = {1.45, 3};
  int smallest_side = 12;  // px of the coarsest level
  // The product of this level and all coarser ones counts by its power 3/4: their windows look across thin
  // things. (The power 1/2: gardens +0.1 to 0.3 dB without depth, slope_jitter enlarged five times -1.0.)
  size_t far_level = 2;
  // Factor of the finest level of a resampled frame. Resampling takes away the finest detail, and its errors
  // look like detail. (0.9 gains two thirds as much, 1: clutter_mild -0.38 dB, 0.7: gardens up to -0.5.)
  float resampled = 0.85f;
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
  float dark = 20;             // gray levels; below, differences in brightness count little
} kSharpness{};

float floorOf(const NoiseSpectrum& noise, size_t level) {
  return static_cast<float>(std::pow(kSharpness.of_finer_level, level) *
                            (kSharpness.rounding + kSharpness.deviations * noise.deviation()));
}

// The modified Laplacian |I_xx| + |I_yy| of a row, by its pixels and those above and below it.
template <typename Value>
inline void laplacianOf(const Value* above, const Value* here, const Value* below, int n,
                        float* __restrict out) {
  for (int i = 0; i < n; ++i) {
    const auto twice = 2 * here[i];
    out[i] = static_cast<float>(std::abs(twice - here[i - 1] - here[i + 1]) +
                                std::abs(twice - above[i] - below[i]));
  }
}

ALL_IN_FOCUS_SIMD void modifiedLaplacian(const float* above, const float* here, const float* below, int n,
                                         float* __restrict out) {
  laplacianOf(above, here, below, n, out);
}

ALL_IN_FOCUS_SIMD void modifiedLaplacian(const std::uint8_t* above, const std::uint8_t* here,
                                         const std::uint8_t* below, int n, float* __restrict out) {
  laplacianOf(above, here, below, n, out);
}

// The modified Laplacian of some rows in a window, gray levels. OpenCV sees the rows around these, too, and
// continues the picture where there are none.
template <typename Value>
void smoothedLaplacian(const cv::Mat_<Value>& image, const cv::Range& rows, const Window& window,
                       cv::Mat1f& out) {
  const cv::Range all(std::max(rows.start - window.radius, 0),
                      std::min(rows.end + window.radius, image.rows));
  cv::Mat_<Value> pixels;
  cv::copyMakeBorder(image.rowRange(all), pixels, 1, 1, 1, 1, cv::BORDER_REPLICATE);
  cv::Mat1f laplacian(all.size(), image.cols);
  for (int y = 0; y < laplacian.rows; ++y) {
    modifiedLaplacian(pixels[y] + 1, pixels[y + 1] + 1, pixels[y + 2] + 1, image.cols, laplacian[y]);
  }
  const int side = 2 * window.radius + 1;
  cv::GaussianBlur(laplacian.rowRange(rows.start - all.start, rows.end - all.start), out, {side, side},
                   window.sigma, window.sigma, cv::BORDER_REFLECT_101);
}

ALL_IN_FOCUS_SIMD void mean(const float* a, const float* b, int n, float* __restrict out) {
  for (int i = 0; i < n; ++i) out[i] = 0.5f * (a[i] + b[i]);
}

// The sum in quadrature: where s is far below the floor, how much it varies does not matter.
ALL_IN_FOCUS_SIMD void raise(float factor, float squared_floor, size_t n, float* s) {
  for (size_t i = 0; i < n; ++i) s[i] = std::sqrt(factor * s[i] * (factor * s[i]) + squared_floor);
}

// The same, less where it is bright.
ALL_IN_FOCUS_SIMD void raise(float factor, float squared_floor, const std::uint8_t* brightness, int n,
                             float* __restrict s) {
  for (int i = 0; i < n; ++i) {
    const float q = 1 + brightness[i] / kSharpness.dark;
    s[i] = std::sqrt((factor * s[i] * (factor * s[i]) + squared_floor) / (q * q * q));
  }
}

// Two pixels of the coarser product make four: 0, 0 | 1, 1, 1 | 2, ...
ALL_IN_FOCUS_SIMD void multiply(const float* coarser, int pairs, float* __restrict s) {
  for (int i = 0; i < pairs; ++i) {
    s[2 * i] *= coarser[i];
    s[2 * i + 1] *= 0.5f * (coarser[i] + coarser[i + 1]);
  }
}

// Some rows of a level: their smoothed Laplacian `s` becomes the product. coarser: the product of the next
// level, whose pixel i lies on pixel 2 i of this one; it is interpolated linearly. Empty: there is none.
// brightness: of the level; empty: does not count.
void toProduct(const cv::Mat1f& coarser, const cv::Range& rows, float factor, float floor,
               const cv::Mat& brightness, cv::Mat1f& s) {
  if (brightness.empty()) raise(factor, floor * floor, s.total(), s[0]);
  for (int y = rows.start; !brightness.empty() && y < rows.end; ++y)
    raise(factor, floor * floor, brightness.ptr(y), s.cols, s[y - rows.start]);
  if (coarser.empty()) return;
  std::vector<float> row(static_cast<size_t>(coarser.cols) + 1);
  for (int y = rows.start; y < rows.end; ++y) {
    mean(coarser[y / 2], coarser[std::min((y + 1) / 2, coarser.rows - 1)], coarser.cols, row.data());
    row[coarser.cols] = row[coarser.cols - 1];
    float* out = s[y - rows.start];
    multiply(row.data(), s.cols / 2, out);
    if (s.cols % 2 == 1) out[s.cols - 1] *= row[s.cols / 2];
  }
}

}  // namespace

void SharpnessPyramid::begin(const cv::Mat& gray, const Gauge& gauge) {
  gray_ = gray;
  gauge_ = gauge;
  trust_ = 1;
  product_.release();
  texture_.release();
  const int side = std::min(gray.cols, gray.rows);
  std::vector<cv::Mat> levels = {gray};
  while (gauge.scales && side >> levels.size() >= kSharpness.smallest_side)
    levels.push_back(nextLevel(levels.back()));
  const size_t coarsest = levels.size() - 1, texture_level = std::min(coarsest, textureLevel(gray.cols)),
               predicted_level = std::min(coarsest, std::max<size_t>(textureLevel(gray.cols), 2) - 1);
  for (size_t l = coarsest; l > 0; --l) {
    if (l == texture_level) texture_.create(levels[l].size());
    addLevel(levels[l], l, l == texture_level);
    if (gauge.trust && l == texture_level) trust_ = trust(gauge.noise.sharpness(l));
    const bool is_predicted = l == predicted_level && !gauge.predicted.empty();
    cv::Mat1f root, fourth_root;
    if (is_predicted || l == kSharpness.far_level) cv::sqrt(product_, root);
    if (l == kSharpness.far_level) {
      cv::sqrt(root, fourth_root);
      cv::multiply(root, fourth_root, product_);
    }
    if (is_predicted && cv::countNonZero(gauge.predicted) == static_cast<int>(gauge.predicted.total())) {
      product_ = root;
    } else if (is_predicted) {
      cv::Mat predicted;
      cv::resize(gauge.predicted, predicted, root.size(), 0, 0, cv::INTER_NEAREST);
      root.copyTo(product_, predicted);
    }
  }
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

// Multiplies the product of all coarser levels by that of a level.
void SharpnessPyramid::addLevel(const cv::Mat1f& image, size_t level, bool is_texture) {
  cv::Mat1b lights;
  if (!gauge_.lights.empty() && image.cols <= kSharpness.finest_of_lights * gauge_.lights.cols)
    cv::resize(gauge_.lights, lights, image.size(), 0, 0, cv::INTER_NEAREST);
  cv::Mat1f product(image.size());
  forEachBlock({0, image.rows}, [&](const cv::Range& rows) {
    cv::Mat1f sharpness = product.rowRange(rows);
    smoothedLaplacian(image, rows, kSharpness.coarser_window, sharpness);
    if (is_texture) sharpness.copyTo(texture_.rowRange(rows));
    if (!lights.empty())
      cv::Mat(cv::min(sharpness, kSharpness.most_near_lights)).copyTo(sharpness, lights.rowRange(rows));
    toProduct(product_, rows, 1, floorOf(gauge_.noise, level), {}, sharpness);
  });
  product_ = product;
}

cv::Mat1f SharpnessPyramid::compute(const cv::Range& rows) const {
  cv::Mat1f sharpness;
  smoothedLaplacian(gray_, rows, kSharpness.finest_window, sharpness);
  const float factor = gauge_.resampled ? kSharpness.resampled : 1;
  toProduct(product_, rows, trust_ * factor, trust_ * floorOf(gauge_.noise, 0), gauge_.brightness, sharpness);
  return sharpness;
}

}  // namespace all_in_focus::core
