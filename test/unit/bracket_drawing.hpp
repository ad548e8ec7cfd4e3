// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <complex>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "alignment/similarity_transform.hpp"

/// Frames of a focus bracket of an endless texture, which is known at every point: a sum of plane waves. So
/// scale, roll and shift of a frame are exact, without any resampling.
namespace bracket_drawing {

using all_in_focus::core::SimilarityTransform;

const cv::Size kSize(320, 240);
const cv::Point2d kCenter(158.3, 123.6);  ///< of the magnification, not of the picture

/// Gray picture of the texture `seed`, moved from the reference, its halves blurred by sigma px, CV_8UC1.
inline cv::Mat frame(const SimilarityTransform& motion, double left_sigma = 0, double right_sigma = 0,
                     int seed = 1) {
  using Waves = std::vector<std::complex<float>>;
  cv::RNG random(seed);
  cv::Mat light(kSize, CV_32FC1, cv::Scalar(120));
  for (int i = 0; i < 100; ++i) {  // of the same contrast in every octave, as in natural pictures
    const double frequency = std::exp(random.uniform(std::log(0.02), std::log(1.5)));  // rad/px
    const double angle = random.uniform(0.0, CV_PI), phase = random.uniform(0.0, 2 * CV_PI);
    const double at_center = frequency * (std::cos(angle) * kCenter.x + std::sin(angle) * kCenter.y);
    const auto along = [&](int length, double k, double center, double shift, std::complex<double> factor) {
      Waves waves(length);
      for (int u = 0; u < length; ++u) {
        waves[u] = factor * std::polar(1.0, k * (u - shift - center) / motion.scale);
      }
      return waves;
    };
    const double rolled = angle + motion.angle;
    const Waves columns = along(kSize.width, frequency * std::cos(rolled), kCenter.x, motion.shift.x,
                                std::polar(5.0, phase + at_center));
    const Waves rows = along(kSize.height, frequency * std::sin(rolled), kCenter.y, motion.shift.y, 1.0);
    for (int y = 0; y < kSize.height; ++y) {
      auto* row = light.ptr<float>(y);
      for (int x = 0; x < kSize.width; ++x) {
        row[x] += columns[x].real() * rows[y].real() - columns[x].imag() * rows[y].imag();
      }
    }
  }
  const cv::Rect left(0, 0, kSize.width / 2, kSize.height), right = left + cv::Point(left.width, 0);
  cv::Mat blurred, gray;
  for (const auto& [half, sigma] : {std::pair(left, left_sigma), std::pair(right, right_sigma)}) {
    if (sigma <= 0) continue;
    cv::GaussianBlur(light, blurred, {}, sigma);
    blurred(half).copyTo(light(half));
  }
  light.convertTo(gray, CV_8U);
  return gray;
}

/// Frame k of n: sharp on the left first, on the right last.
inline cv::Mat refocused(const SimilarityTransform& motion, int k, int n, double widest_sigma = 3) {
  const double t = n > 1 ? static_cast<double>(k) / (n - 1) : 0.5;
  return frame(motion, widest_sigma * t, widest_sigma * (1 - t));
}

inline void addNoise(double sigma, int seed, cv::Mat& gray) {
  cv::Mat noise(gray.size(), CV_16SC1), sum;
  cv::RNG random(seed);
  random.fill(noise, cv::RNG::NORMAL, 0, sigma);
  cv::add(gray, noise, sum, cv::noArray(), CV_16S);
  sum.convertTo(gray, CV_8U);
}

}  // namespace bracket_drawing
