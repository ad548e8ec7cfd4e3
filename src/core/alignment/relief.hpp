// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "alignment/similarity_transform.hpp"

namespace all_in_focus::core {

/// How a camera that moves finds the reference's pixels: near ones move more than far ones. Relief is inverse
/// depth, less its mean, in standard deviations.
struct Relief {
  cv::Mat1w measured;  ///< seen from the colour camera, any size, mm, 0 = unknown; empty: no depth is known
  cv::Mat1w filled;    ///< the same, holes filled
  double mean = 0, deviation = 0;  ///< of the measured inverse depth, 1/mm; deviation 0: nothing is known

  bool isKnown() const { return deviation > 0; }
  float of(std::uint16_t depth_mm) const { return static_cast<float>((1.0 / depth_mm - mean) / deviation); }
};

/// measured: empty: all of filled was measured. Empty or flat depth has no relief.
Relief reliefOf(const cv::Mat& filled, const cv::Mat& measured);

/// Relief in a rectangle of a picture of that size. NaN where little of it was measured, or where a depth
/// edge crosses it.
float reliefIn(const Relief& relief, const cv::Rect2d& area, const cv::Size& size);

/// The motion that CameraMotion stands for.
struct CameraPose {
  cv::Vec3d place_mm;  ///< seen from the reference: right, down, ahead
  cv::Vec3d rotation;  ///< radians about these axes
};
CameraPose poseOf(const CameraMotion& motion, const Relief& relief, double focal_px, const cv::Size& size);

/// Relief of every pixel of a picture of that size, CV_32FC1. A pixel of unknown depth has that of the
/// nearest known one. Relief must be known.
cv::Mat1f reliefImage(const Relief& relief, const cv::Size& size);

/// What the frame of a camera that has moved shows of each pixel of the reference.
struct ParallaxView {
  cv::Mat2f map;    ///< where it lies in the frame
  cv::Mat1b shown;  ///< 0: something nearer hides it in the frame, or it lies outside
};
ParallaxView viewOf(const CameraMotion& motion, const cv::Mat1f& relief, const cv::Point2d& center);

}  // namespace all_in_focus::core
