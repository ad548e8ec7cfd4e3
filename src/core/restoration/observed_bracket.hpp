// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "optics/disc_blur.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {

/// A frame of a bracket in the form in which restoration compares it with predictions.
struct ObservedFrame {
  cv::Mat3s codes;  ///< 8-bit codes times kCodeScale, with the exposure of the fused picture
  cv::Mat1b shown;  ///< 0 where its pixels are not valid, else 255
  FrameBlur blur;
  bool is_exact = true;  ///< its contours lie where the fused picture has them
};

/// A bracket, the picture it was fused to, and its depth. All have one size, one geometry and one exposure.
struct ObservedBracket {
  cv::Mat3b fused;
  const LightCurve* curve = &LightCurve::srgb();  ///< of the camera
  cv::Mat3f light;                                ///< linear light of it, 0..1
  std::vector<ObservedFrame> frames;              ///< by inverse depth of focus, far first
  double noise_variance = 0;                      ///< gray levels squared, of a channel
  cv::Mat1f measured;  ///< inverse depth (1 / depth, 1/mm) that a sensor measured, 0 = unknown; may be empty
  cv::Mat1f filled;    ///< the same with filled holes

  /// The largest of the frames' FrameBlur::px_mm.
  double pxMm() const;
  /// Difference in inverse depth that changes the blur by so many pixels of radius.
  float gap(double px) const { return static_cast<float>(px / pxMm()); }
};

constexpr double kJumpPx = 0.35;  ///< neighbours that differ by more do not lie on one surface

/// CV_8UC1, 255 at both pixels of every pair of neighbours whose inverse depth differs by more than a gap.
cv::Mat1b jumps(const cv::Mat1f& inverse_depth, float gap);

/// The same, and all pixels within a reach of them, px.
cv::Mat1b besideJumps(const cv::Mat1f& inverse_depth, float gap, int reach);

/// Distance, px, of each pixel from the nearest hole or jump of the measured depth.
cv::Mat1f distanceFromDoubt(const ObservedBracket& bracket);

/// A frame, CV_8UC3, in the exposure of the fused picture: see ObservedFrame::codes. gain: in linear light,
/// as if codes were sRGB.
cv::Mat3s exposed(const cv::Mat& frame, double gain, const LightCurve& curve);

}  // namespace all_in_focus::core
