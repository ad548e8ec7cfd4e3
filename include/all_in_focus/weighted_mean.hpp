// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// What speaks for a frame, pixel by pixel. CV_32FC1, gray levels; an empty one says nothing.
struct Evidence {
  cv::Mat sharpness;         ///< modified Laplacian in a small window
  cv::Mat sharpness_around;  ///< and in a large one: decides where the small one holds no texture
  cv::Mat squared_error;     ///< that depth and optics predict
  double trust = 1;          ///< in the frame as a whole; > 0
};

/// Running weighted mean of frames, pixel by pixel, and which of them weighed most. Keeps one sum per pixel,
/// however many frames there are.
///
/// A frame weighs
///   trust (sharpness + noise)^6 (sharpness around + noise)^2 / (predicted squared error + noise variance):
/// the inverse of the variance that is expected of it, times a softmax, the powers, of what is seen. As
/// powers of such numbers cannot overflow (sharpness <= 1020), the sum needs no running maximum.
class WeightedMean {
 public:
  /// noise: standard deviation of the frames' noise in gray levels, >= 0. soft: false = the frame that weighs
  /// most is copied, for comparison.
  void begin(const cv::Size& size, double noise, bool soft = true);

  /// frame: CV_8UC3; codes: the value that each of its 8-bit values stands for; evidence: of the frame's
  /// size; inside: pixels that the frame has seen.
  void add(const cv::Mat& frame, const std::array<float, 256>& codes, const Evidence& evidence,
           const cv::Rect& inside, int index);

  /// Mean modified Laplacian of the noise alone.
  double sharpnessOfNoise() const { return sharpness_of_noise_; }

  cv::Mat image() const;  ///< CV_8UC3
  const cv::Mat& sourceIndex() const { return source_index_; }
  cv::Mat confidence() const;  ///< CV_8UC1: 255 (1 - mean weight / largest), scaled so that 255 = no rival

 private:
  bool soft_ = true;
  int frames_ = 0;
  double sharpness_of_noise_ = 0;
  float sharpness_floor_ = 1, error_floor_ = 1;
  cv::Mat sum_;   // CV_32FC4: blue, green, red times weight (hard: of the heaviest frame); weight
  cv::Mat most_;  // CV_32FC1
  cv::Mat source_index_;
};

}  // namespace all_in_focus::core
