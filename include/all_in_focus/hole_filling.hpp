// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// Maximum of the 3 x 3 neighbours inside the image (equation 4). depth, dilated: CV_16UC1 mm, 0 = unknown;
/// may be the same image. As printed in the paper, this also widens far surfaces by a pixel at the cost of
/// near ones. Throws std::invalid_argument on another type or an empty image.
void dilateDepth(const cv::Mat& depth, cv::Mat& dilated);

/// Fills holes by one step of anisotropic diffusion from two rows above (equations 5 to 8), in place and row
/// by row, so that rows below use what has just been filled. Tables are reused between calls: not
/// thread-safe.
class DiffusionFilling {
 public:
  double lambda = 0.25;       ///< step of equation 7, 0..0.25
  double conduction_mm = 25;  ///< K of equation 6
  int hole_below_mm = 10;     ///< every smaller depth is a hole

  /// depth: CV_16UC1 mm. The first three rows have no rows above them and stay as they are. Beyond the first
  /// and the last column the gradient is 0. A hole stays one if the pixel two rows above is still a hole.
  /// Throws std::invalid_argument on another type, an empty image, a conduction that is not positive or an
  /// impossible lambda.
  void fill(cv::Mat& depth);

 private:
  void tabulateFlows();

  double tabulated_conduction_mm_ = 0;
  int reach_ = 0;              ///< mm; no flow beyond
  std::vector<double> flows_;  ///< C d (equations 5 and 6) for d = -reach..reach mm
};

/// Fills each hole across its narrow side (row or column, whichever run of unknown pixels is shorter) from
/// the farther of the two ends, because a shadow of the sensor falls on what lies behind the near object.
/// Where neither row nor column has two ends the sensor sees nothing at all, and depth stays unknown. Buffers
/// are reused between calls: not thread-safe.
class FarSideFilling {
 public:
  /// depth, filled: CV_16UC1 mm, 0 = unknown, fewer than 65535 rows and columns; not the same image. Throws
  /// std::invalid_argument on another type or an empty image.
  void fill(const cv::Mat& depth, cv::Mat& filled);

 private:
  /// Rows filled by one thread, with the holes that it met before it knew their lower or upper end.
  struct Band {
    std::vector<std::uint64_t> holes;  ///< of the last row, a bit each
    std::vector<std::uint16_t> begin;  ///< by column: first row of the last hole; 0: begins above the band
    std::vector<std::uint16_t> end;    ///< by column: row below the hole that begins above the band, 0 = none
  };

  void fillBand(const cv::Mat& depth, const cv::Range& rows, Band& band, cv::Mat& filled);
  void fillAcross(const std::uint16_t* row, int cols, int begin, int end, int i, cv::Mat& filled);
  void fillDown(const cv::Mat& depth, int column, int begin, int end, cv::Mat& filled);

  cv::Mat1w width_;  ///< of each hole pixel: of the hole in its row
  std::vector<Band> bands_;
};

}  // namespace all_in_focus::core
