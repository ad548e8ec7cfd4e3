// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

namespace all_in_focus::core {

/// So many times the measured noise may occur: frames differ in their noise, and places in a frame.
constexpr double kNoiseMargin = 1.25;

/// The next level of a Gaussian pyramid, CV_32FC1 gray levels. image: CV_8UC1 or CV_32FC1.
cv::Mat nextLevel(const cv::Mat& image);

/// How sharp noise alone looks at each level of a Gaussian pyramid. It is measured at every level, since the
/// noise of a camera is not white: demosaicing, JPEG and enlarging correlate it over several pixels.
class NoiseSpectrum {
 public:
  NoiseSpectrum() = default;  ///< no noise

  /// measured: mean modified Laplacian |I_xx| + |I_yy| of quiet places, gray levels >= 0; finest level first.
  explicit NoiseSpectrum(std::vector<double> measured) : measured_(std::move(measured)) {}

  /// Of a picture: that of its quietest places, the tenth percentile of blocks of 8 x 8 pixels, by a mask
  /// that is blind to planes and edges (Immerkaer, Fast Noise Variance Estimation, 1996); texture lifts it
  /// only where it covers nine tenths of a level. Blocks that are nearly black or white do not count: noise
  /// is cut off there. Levels with too few blocks are not measured.
  ///
  /// others: frames of the same bracket. At each level the lowest of these values counts: the noise of the
  /// picture, that of each other frame, and that of its difference to the picture, divided by the root of 2.
  /// Texture that two frames show alike is no part of their difference, noise is. Frames may differ in blur,
  /// motion and exposure: that only adds to the difference. A frame with too few blocks, as a black or white
  /// one, does not count. None may be a copy of the picture.
  /// gray, others: CV_8UC1 of one size, not empty.
  static NoiseSpectrum of(const cv::Mat& gray, std::vector<cv::Mat> others = {});

  /// Mean modified Laplacian at a level: at least 0.4 times that of the finer level, and exactly that where
  /// it was not measured. (White noise has 0.27 times that of the finer level, noise of cameras has more.)
  double sharpness(std::size_t level) const;

  /// Standard deviation, gray levels, of white noise that looks as sharp at the finest level.
  double whiteDeviation() const;

  /// The same of a pixel, whether the noise is white or not.
  double deviation() const;

 private:
  std::vector<double> measured_;
};

}  // namespace all_in_focus::core
