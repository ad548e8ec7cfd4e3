// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// One gain per frame, in linear light (sRGB), that gives it the exposure of the reference frame.
///
/// It is the median, over blocks of the picture, of the ratio of their mean light. Blur leaves the mean light
/// of a block alone but for what crosses its border and for a tone curve that is not sRGB's, so textured
/// blocks do not count.
class ExposureMatching {
 public:
  static constexpr double kLargestGain = 2;

  /// gray: CV_8UC1.
  void setReference(const cv::Mat& gray) { reference_ = blocksOf(gray); }

  /// Gain for a frame that is aligned to the reference to a few pixels: 1 / kLargestGain..kLargestGain, and 1
  /// where it is not significant. gray: CV_8UC1, of the reference's size.
  double gain(const cv::Mat& gray) const;

 private:
  struct Blocks {
    cv::Mat1f light;   ///< mean, 0..1
    cv::Mat1b counts;  ///< 0: too dark, bright or textured
  };
  static Blocks blocksOf(const cv::Mat& gray);

  Blocks reference_;
};

/// The code, 0..255, that the reference would have shown.
double codeWithGain(double code, double gain);

/// The same for each code of a frame, CV_8U or CV_16U, in codes of 16 bits, rounded; empty: as they are.
std::vector<std::uint16_t> gainLut(double gain, int depth);

}  // namespace all_in_focus::core
