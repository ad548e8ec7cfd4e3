// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/fusion.hpp"
#include "all_in_focus/optics.hpp"

namespace all_in_focus::core {

/// Predicts from depth and optics alone how blurred a frame is: the expected squared error, in gray levels,
/// of each of its pixels against the sharp picture.
///
/// A disc of diameter b, the blur circle, spreads light with variance b^2 / 16 along each axis, so that the
/// picture changes by b^2 / 32 of its Laplacian, and by 4 times that at most: even a wide disc takes away no
/// more than the contrast there is. The Laplacian is the largest any frame has shown nearby so far
/// (addTexture), at most that of a textured picture: on bare surfaces more frames will do, and their mean has
/// less noise. A disc of a nearer surface whose share c lies over a pixel changes it, too, also where it is
/// bare: the glow of near things. It counts as 72 c gray levels, and three times as many as the light of the
/// first frame, spread by that disc, makes the pixel brighter or darker. As depth edges are uncertain, the
/// expectation is taken over their displacement: a Gaussian mean. Beside an edge, frames in which either
/// surface is blurred are thus expected to err, and sharpness decides.
class DefocusPrediction {
 public:
  /// depth: CV_16UC1 mm, 0 = unknown, seen from the colour camera, any size. measured: the same before holes
  /// were filled, or empty. size: of the frames. pixel_pitch_mm: > 0.
  void begin(const cv::Mat& depth, const cv::Mat& measured, const cv::Size& size, const Optics& optics,
             double pixel_pitch_mm);

  /// Another f-number than that of the optics.
  void setAperture(double aperture) { optics_.aperture = aperture; }

  /// Level of the Gaussian pyramid of a frame at which texture is measured: 1 in a picture 640 wide, and as
  /// coarse in a wider one, where blur is wider, too.
  std::size_t textureLevel() const { return texture_level_; }

  /// Adds the texture of a frame: modified Laplacian of that level, gray levels, CV_32FC1. noise: the same of
  /// noise alone. Until the first frame is added, the whole picture counts as textured.
  void addTexture(const cv::Mat& sharpness, double noise);

  /// The first frame, in gray levels, CV_8UC1: how surfaces look. Without it they all look alike.
  void setPicture(const cv::Mat& gray);

  /// Where depth predicts the blur: CV_8UC1, 255 or 0, on the grid.
  cv::Mat known() const { return per_known_ > 0; }

  /// squared_error: CV_32FC1, on a grid about as coarse as edges are uncertain; upsample it linearly to the
  /// size of the frames. The same for all frames where depth is unknown, and for a frame whose focus_mm is
  /// NaN. focus_mm is beyond f, may be infinite.
  void compute(double focus_mm, cv::Mat& squared_error);

 private:
  void addGlow(double focus_mm, cv::Mat& squared_error);

  // Cells whose inverse depth lies in one part of its range.
  struct Slab {
    double depth_mm;
    cv::Mat cells;  // CV_8UC1, 255 or 0
    cv::Mat light;  // CV_8UC2: the same, and the picture there
  };

  Optics optics_;
  double pixel_pitch_mm_ = 0;
  int cell_ = 1;              // side of a cell of the grid, px
  double edge_error_px_ = 0;  // on the grid
  cv::Size window_;           // of a Gaussian of that deviation: three of them to each side
  std::size_t texture_level_ = 1;

  // On a grid as coarse as the edges of depth are uncertain.
  cv::Mat1f inverse_depth_;  // 1/mm, 0 = unknown
  cv::Mat1f constant_;       // error that all frames share: the doubt in filled depth
  cv::Mat1f per_known_;      // 1 / share of known depth under the Gaussian; 0 where there is none
  cv::Mat1f laplacian_;      // largest so far above the noise; empty: not known
  float hidden_ = 0;         // Laplacian of texture that noise may hide
  std::vector<Slab> slabs_;  // the nearest first
  cv::Mat picture_;          // CV_8UC1, gray levels
  cv::Mat1f error_;
};

}  // namespace all_in_focus::core
