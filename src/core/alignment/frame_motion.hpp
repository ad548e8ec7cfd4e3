// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "util/image_rows.hpp"

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

/// Brings frames into the geometry of the reference: out(p) = frame(p') by a separable Lanczos kernel of six
/// taps. What a frame does not show is continued from its border.
class ReferenceWarp {
 public:
  static constexpr int kTaps = 6;

  /// frame: CV_8UC3, else std::invalid_argument; not shared with out. motion: from the reference to the
  /// frame.
  void compute(const cv::Mat& frame, const Motion& motion, const cv::Point2d& center, cv::Mat& out);

 private:
  struct Axis {  ///< where each row or column of the output comes from: pixels first, first + 1, ...
    std::vector<int> first;
    std::vector<std::array<float, kTaps>> weight;
    void prepare(int length, double scale, double center, double shift);
  };
  struct Strip {
    LineBuffer along;  ///< rows of the frame that have been warped along x
    std::vector<float> padded;
  };

  void prepareColumns(int columns, const Motion& motion, const cv::Point2d& center);
  void warpAlong(const std::uint8_t* from, std::vector<float>& padded, float* out) const;

  Axis rows_, columns_;
  std::vector<TapRun> runs_;
  std::vector<float> column_weights_;  ///< by tap, column, channel
  std::vector<Strip> strips_;
};

}  // namespace all_in_focus::core
