// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "alignment/hidden_parallax.hpp"
#include "alignment/image_pyramid.hpp"
#include "alignment/relief.hpp"
#include "alignment/similarity_transform.hpp"

namespace all_in_focus::core {

struct PairMeasurement {
  SimilarityTransform motion;  ///< from the key frame to the frame
  /// px^2, of magnification and roll (both at half a diagonal from the centre) and shift x, y
  cv::Matx44d covariance;
  double tiles = 0;             ///< so many tiles of equal texture would tell as much
  bool converged = false;       ///< otherwise motion and parallax are the guess
  cv::Vec2d turn;               ///< see CameraMotion
  cv::Matx22d turn_covariance;  ///< px^2; zeros: not measured
  /// Where relief is known, see CameraMotion. Without `parallax` in measure(): what one more step would find.
  cv::Vec3d parallax;
  cv::Matx33d parallax_covariance;  ///< px^2; zeros: unknown
  CellShifts shifts;                ///< beside the motion; only where no relief is known
  double correlation = 0;           ///< of the local contrast of both frames, once aligned
};

/// What a motion may be beside magnification, roll and shift.
struct Freedom {
  bool turn = false, parallax = false;  ///< see CameraMotion; parallax: relief must be known
  double turn_per_shift = 0;            ///< that is known, of the shift that is no parallax of the mean depth

  bool isNone() const { return !turn && !parallax && turn_per_shift == 0; }
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
/// Two more unknowns of the motion are a turn of the camera. Where the relief of a tile is known, it may have
/// a parallax, too: three more. Tiles without relief then do not count, for nobody knows how far they move.
///
/// Frames are read as coefficients of cubic B-splines. That smooths them, but unlike an interpolation it
/// moves them by fractions of a pixel without bias: cv::warpAffine, linear, is off by up to 0.06 px where
/// this is by 0.003, which costs 0.3 dB where a head sags.
class PairAlignment {
 public:
  /// Relief of the key frames from now on.
  void setRelief(const Relief& relief);

  /// center: fixed point of the magnification, pixels of the frame.
  void setKey(const ImagePyramid& key, const cv::Point2d& center);

  /// frame: of the key's size.
  PairMeasurement measure(const ImagePyramid& frame, const CameraMotion& guess, const Freedom& freedom = {});

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
    std::vector<float> relief;  ///< of the tiles, NaN = unknown; empty: of all
  };
  /// Magnification and roll at the radius, shift x, y, turn x, y, parallax; pixels of the level.
  using Motion = cv::Vec<double, 9>;
  using Covariance = cv::Matx<double, 9, 9>;
  struct Estimate {
    Motion motion;
    Covariance covariance;
    double tiles = 0;
    double step = 0;  ///< the last one
  };
  /// What a tile tells of its shift.
  struct Pull {
    double x, y;  ///< its centre, in units of the radius
    double relief;
    double weight;
    cv::Matx22d information;
    cv::Vec2d pull;
  };

  /// A motion in a level, as two shears (Catmull and Smith 1980): row y of the result is read across the rows
  /// of the picture first, at v(u, y), and along the row that this gives then, at u(x, y).
  struct Shears {
    Shears(const Motion& motion, const Level& level, const cv::Size& picture);
    Shears movedBy(double x, double y) const;
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
  cv::Vec2d turnOf(const Motion& motion) const;
  template <int N>
  double step(const Level& level, Estimate& estimate) const;
  CellShifts shifts(const Level& level) const;
  Estimate refine(const Level& level, const cv::Mat& image, const Motion& guess);
  void sampleRow(const cv::Mat& image, const Shears& shears, const cv::Point& at, int width, float* out);

  Relief relief_;
  Freedom freedom_;               ///< of the motion that is measured
  double shift_of_parallax_ = 0;  ///< that its mean depth has, px each
  std::vector<Level> levels_;
  cv::Mat contrast_;

  Taps across_, along_;
  std::vector<float> row_, band_;  ///< of the frame: one row; a row of tiles
  std::vector<Pull> pulls_;
};

}  // namespace all_in_focus::core
