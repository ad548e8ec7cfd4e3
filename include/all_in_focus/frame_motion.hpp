// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// Where a point p of one frame of a bracket lies in another: p' = center + scale (p - center) + shift,
/// pixels. Refocusing changes the magnification, a knock moves the picture; a camera on a stand does not
/// roll.
struct Motion {
  double scale = 1;
  cv::Point2d shift;

  bool isIdentity() const { return scale == 1 && shift == cv::Point2d(); }
};

/// First `first`, then `second`, both about the same centre.
Motion chain(const Motion& first, const Motion& second);

Motion inverse(const Motion& motion);

/// How far the motion moves any point of a picture at most, pixels.
double largestDisplacement(const Motion& motion, const cv::Size& size, const cv::Point2d& center);

/// Brings a frame into the geometry of the reference: out(p) = frame(p') by a separable Lanczos kernel of six
/// taps. What the frame does not show is continued from its border. frame: CV_8UC3, not shared with out;
/// motion: from the reference to the frame.
void warpToReference(const cv::Mat& frame, const Motion& motion, const cv::Point2d& center, cv::Mat& out);

}  // namespace all_in_focus::core
