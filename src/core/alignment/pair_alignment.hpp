// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "alignment/frame_motion.hpp"
#include "alignment/image_pyramid.hpp"

namespace all_in_focus::core {

struct PairMeasurement {
  Motion motion;           ///< from the key frame to the frame
  cv::Matx33d covariance;  ///< px^2, of magnification (at half a diagonal from the centre) and shift x, y
  bool converged = false;  ///< otherwise the motion is the guess
  double correlation = 0;  ///< of the local contrast of both frames, once aligned
};

/// Magnification and shift between two frames that are focused differently, to a few hundredths of a pixel.
///
/// Gauss-Newton, coarse to fine, on I_b(T(p)) - I_a(p); a is the key frame. With the focus the blur changes
/// too, in one sense for near and in the other for far parts, and the light may. So each tile of 8 x 8 pixels
/// has three unknowns of its own,
///   I_b(T(p)) - I_a(p) = J(p) d + offset_t + gain_t I_a(p) + blur_t laplacian I_a(p),
/// and a weight by what they leave unexplained. They are eliminated beforehand: J is made orthogonal to them.
///
/// Frames are read as coefficients of cubic B-splines. That smooths them, but unlike an interpolation it
/// moves them by fractions of a pixel without bias.
class PairAlignment {
 public:
  /// center: fixed point of the magnification, pixels of the frame.
  void setKey(const ImagePyramid& key, const cv::Point2d& center);

  /// frame: of the key's size.
  PairMeasurement measure(const ImagePyramid& frame, const Motion& guess);

 private:
  static constexpr int kTile = 8;
  using Pixels = std::array<float, kTile * kTile>;

  struct Tile {
    Pixels image;                    ///< I_a
    std::array<Pixels, 3> nuisance;  ///< offset, gain, blur; orthonormal
    std::array<Pixels, 3> jacobian;  ///< J, orthogonal to the nuisances
    cv::Matx33d information;         ///< J^T J
  };
  struct Level {
    cv::Size size, grid;  ///< pixels; tiles
    cv::Point origin;     ///< of the first tile
    cv::Point2d center;
    double reduction = 0, radius = 0;  ///< half the diagonal
    std::vector<Tile> tiles;
  };
  struct Estimate {
    cv::Vec3d motion;  ///< magnification at the radius, shift x, y; pixels of the level
    cv::Matx33d covariance;
    double step = 0;  ///< the last one
  };

  struct Axis {  ///< one axis of a motion in a level: u' = center + scale (u - center) + shift
    double scale, center, shift;
    int length;  ///< of the picture that is read

    double operator()(int u) const { return center + scale * (u - center) + shift; }
    bool covers(int first, int last) const { return (*this)(first) >= 1 && (*this)(last) <= length - 2; }
  };
  struct Columns {
    std::vector<TapRun> runs;
    std::vector<float> weights;  ///< by tap, column
    void prepare(const Axis& axis, int origin, int width);
  };

  static void fill(const Level& level, const cv::Mat& image, const cv::Point& corner, Tile& tile);
  Estimate refine(const Level& level, const cv::Mat& image, const cv::Vec3d& guess);
  void sampleRow(const cv::Mat& image, double y, int width, float* out);

  std::vector<Level> levels_;
  cv::Mat contrast_;

  Columns columns_;
  std::vector<float> row_, band_;  ///< of the frame: one row; a row of tiles
  cv::Mat aligned_;
};

}  // namespace all_in_focus::core
