// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// 3x3 maximum (equation 4), borders ignored. CV_16UC1 mm in and out, may be in place.
/// As printed it also lets the farther surface eat one pixel of every nearer object.
void dilateDepth(const cv::Mat& depth, cv::Mat& dilated);

/// One step of anisotropic diffusion from two rows above (equations 5 to 8), in place, in row order, so that
/// values just filled serve the rows below.
struct DiffusionFilling {
  double lambda = 0.25;       ///< step, 0..0.25
  double conduction_mm = 25;  ///< K of equation 6
  int hole_below_mm = 10;     ///< every smaller depth is a hole

  /// depth: CV_16UC1 mm. The first three rows have nothing above them and stay as they are; beyond the first
  /// and the last column there is no gradient; a hole under a hole stays one.
  void fill(cv::Mat& depth) const;
};

/// Fills each hole across its narrow side (row or column, whichever run of unknown pixels is shorter) from
/// the farther of the two ends: what a near object hides belongs to what lies behind it. Where neither row
/// nor column has two ends the sensor could not see at all, and depth stays unknown. Buffers are reused.
class FarSideFilling {
 public:
  /// depth and filled: CV_16UC1 mm; not the same image.
  void fill(const cv::Mat& depth, cv::Mat& filled);

 private:
  cv::Mat_<cv::Vec2w> above_;  ///< of each hole pixel: nearest known depth above (0 = none), its distance
  std::vector<cv::Vec2w>
      column_;  ///< the same for the row at hand, above on the way down, below on the way up
};

}  // namespace all_in_focus::core
