// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "alignment/image_pyramid.hpp"
#include "alignment/similarity_transform.hpp"

namespace all_in_focus::core {

struct PairMeasurement {
  SimilarityTransform motion;  ///< from the key frame to the frame
  /// px^2, of magnification and roll (both at half a diagonal from the centre) and shift x, y
  cv::Matx44d covariance;
  double tiles = 0;        ///< so many tiles of equal texture would tell as much
  bool converged = false;  ///< otherwise the motion is the guess
  double correlation = 0;  ///< of the local contrast of both frames, once aligned
};

/// Magnification, roll and shift between two frames that are focused differently, to a few hundredths of a
/// pixel.
///
/// Gauss-Newton, coarse to fine, on I_b(T(p)) - I_a(p); a is the key frame. Refocusing also makes near parts
/// more and far parts less blurred, or the other way round, and the light may change. So each tile of 8 x 8
/// pixels has three unknowns of its own,
///   I_b(T(p)) - I_a(p) = J(p) d + offset_t + gain_t I_a(p) + blur_t laplacian I_a(p),
/// and a weight by what they leave unexplained. Making the gradients in J orthogonal to these three
/// eliminates them, and with them I_a itself. All pixels of a tile move as its centre.
///
/// Frames are read as coefficients of cubic B-splines. That smooths them, but unlike an interpolation it
/// moves them by fractions of a pixel without bias: cv::warpAffine, linear, is off by up to 0.06 px where
/// this is by 0.003, which costs 0.3 dB where a head sags.
class PairAlignment {
 public:
  /// center: fixed point of the magnification, pixels of the frame.
  void setKey(const ImagePyramid& key, const cv::Point2d& center);

  /// frame: of the key's size.
  PairMeasurement measure(const ImagePyramid& frame, const SimilarityTransform& guess);

 private:
  static constexpr int kTile = 8;
  using Pixels = std::array<float, kTile * kTile>;

  struct Tile {
    std::array<Pixels, 2> nuisance;  ///< gain, blur; orthonormal, and orthogonal to a constant, the offset
    std::array<Pixels, 2> gradient;  ///< of I_a, along x and y; orthogonal to the three nuisances
    cv::Matx22d information;         ///< of the tile's shift: products of the gradients
  };
  struct Level {
    cv::Size size, grid;  ///< pixels; tiles
    cv::Point origin;     ///< of the first tile
    cv::Point2d center;
    double reduction = 0, radius = 0;  ///< half the diagonal
    std::vector<Tile> tiles;
  };
  struct Estimate {
    cv::Vec4d motion;  ///< magnification and roll at the radius, shift x, y; pixels of the level
    cv::Matx44d covariance;
    double tiles = 0;
    double step = 0;  ///< the last one
  };

  /// A motion in a level, as two shears (see ReferenceWarp): row y of the result is read across the rows of
  /// the picture first, at v(u, y), and along the row that this gives then, at u(x, y).
  struct Shears {
    Shears(const cv::Vec4d& motion, const Level& level, const cv::Size& picture);
    bool cover(const cv::Rect& tile) const;  ///< whether the picture has all its pixels and their neighbours

    cv::Size picture;
    double u0, u_x, u_y;  ///< u = u0 + u_x x + u_y y
    double v0, v_u, v_y;  ///< v = v0 + v_u u + v_y y
  };
  struct Taps {  ///< of a row of positions
    std::vector<int> first;
    std::vector<float> fraction;
    void prepare(double begin, double step, int count, int length);
  };

  static void fill(const cv::Mat& image, const cv::Point& corner, Tile& tile);
  Estimate refine(const Level& level, const cv::Mat& image, const cv::Vec4d& guess);
  void sampleRow(const cv::Mat& image, const Shears& shears, const cv::Point& at, int width, float* out);

  std::vector<Level> levels_;
  cv::Mat contrast_;

  Taps across_, along_;
  std::vector<float> row_, band_;  ///< of the frame: one row; a row of tiles
  cv::Mat aligned_;
};

}  // namespace all_in_focus::core
