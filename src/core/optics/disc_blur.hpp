// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/optics.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {

constexpr int kCodeScale = 16;  ///< codes as integers have fractions of a gray level

/// How far a frame is out of focus: radius of the blur disc, px, of a point at inverse depth w = 1 / depth,
/// 1/mm.
struct FrameBlur {
  double inverse_depth = 0;  ///< of the focus distance
  double px_mm = 0;          ///< radius per inverse depth: f^2 / (2 F pitch) u / (u - f)
  double focal_length_mm = 0;

  float radius(float w) const {
    return std::abs(static_cast<float>(px_mm) * (w - static_cast<float>(inverse_depth)));
  }
  /// The same lens, focused elsewhere.
  FrameBlur focusedAt(double w) const {
    return {w, px_mm * ((1 - focal_length_mm * inverse_depth) / (1 - focal_length_mm * w)), focal_length_mm};
  }
};

/// Of a lens in front of pixels of that pitch, mm.
FrameBlur frameBlur(const Optics& optics, double pixel_pitch_mm, double inverse_depth);

/// Which share of a disc falls on each pixel, by radius and offset from its centre.
class DiscKernels {
 public:
  static constexpr int kStepsPerPx = 8;         ///< radii are rounded to eighths
  static constexpr int kLargestPx = 16;         ///< larger radii count as this one
  static constexpr int kSide = kLargestPx + 2;  ///< offsets 0..kLargestPx + 1
  static const DiscKernels& get();

  static int index(float radius) {
    return std::min(static_cast<int>(radius * kStepsPerPx + 0.5f), kLargestPx * kStepsPerPx);
  }

  /// Shares by kSide |dy| + |dx|.
  const float* shares(int index) const { return &shares_[static_cast<size_t>(index) * kSide * kSide]; }

  /// Index of the smallest disc that has a share at (dx, dy), by dx, which may be negative; 255: none has. dy
  /// >= 0. What follows the largest offset is 255, too, for kSide columns at least.
  const std::uint8_t* leastIndices(int dy) const {
    return &least_[static_cast<size_t>(dy) * 4 * kSide + kSide];
  }

  /// Offsets beyond which there is no share.
  int reach(int index) const { return reach_[index]; }

  /// Variance of the shares along an axis, px^2: how much they blur. A disc by itself has radius^2 / 4;
  /// pixels that it covers in part add to that.
  double variance(double radius) const;

  /// The radius of the disc with that variance.
  float radius(double variance) const;

 private:
  DiscKernels();
  std::vector<float> shares_;
  std::vector<int> reach_;
  std::vector<double> variance_;
  std::vector<std::uint8_t> least_;
};

/// Convolution with a disc of DiscKernels; the picture is mirrored at its border.
/// image: CV_32FC3; out is not image. radius <= DiscKernels::kLargestPx.
void blurByDisc(const cv::Mat& image, float radius, cv::Mat& out);

/// A sharp picture as it looks at every amount of defocus: blurred by discs of growing radius.
class BlurredPictures {
 public:
  /// light: linear light; curve: of the camera; largest: radius in px, cut at DiscKernels::kLargestPx.
  BlurredPictures(const cv::Mat3f& light, const LightCurve& curve, double largest);

  /// Codes times kCodeScale, of the radius nearest to this one.
  const cv::Mat3s& at(float radius) const;

 private:
  std::vector<cv::Mat3s> codes_;
};

}  // namespace all_in_focus::core
