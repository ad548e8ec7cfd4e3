// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

namespace all_in_focus::core {

/// The numbers of alignment. A length is in pixels of the frames, or of the level of the pyramid where that
/// is said.
inline constexpr struct AlignmentParameters {
  // A frame as a pyramid.
  int largest_level = 1 << 20;  ///< pixels; larger levels would take time
  int smallest_side = 24;       ///< px of the coarsest level; a smaller picture says little
  double contrast_sigma = 3;    ///< px of the coarsest level

  // The motion of a pair of frames.
  int border = 2;                ///< px of a level that smoothing has spoilt
  int iterations = 5;            ///< at each level
  double small_step = 0.01;      ///< px of a level: converged; the next step would be a tenth of it
  double largest_step = 0.03;    ///< px of a level: not converged
  double largest_motion = 0.05;  ///< of the radius, or of the width
  /// Factor of largest_motion where parallax is measured. (1: slope -5.4 and clutter -6.6 dB at 60 mm)
  double farther_by_parallax = 2;
  double contrast_floor = 0.5;  ///< gray levels; below, contrast may be noise
  double residual_floor = 0.2;  ///< gray levels; rounding leaves as much (0: garden_sag -0.11 dB)
  /// Neighbouring tiles err alike: so many count as one. (1: frames of occluders_28mm are moved that have not
  /// moved, -4.6 dB)
  double shared_edges = 4;

  // The motion of a frame of a bracket.
  double same_scene = 0.8;     ///< least correlation; frames far out of focus reach 0.9, other scenes 0.5
  double far_from_key = 0.03;  ///< motion relative to the key frame, of the radius
  std::size_t most_keys = 12;  ///< that are kept: a third of the magnification
  /// A contour whose blur changes shifts all of its tiles alike. This error of a single tile, of the radius,
  /// falls with the root of their number, because the shifts of many contours cancel each other: 0.05 px of
  /// 640 x 480 where 100 tiles tell the motion. (Without it plain, enlarged five times, loses 1.3 dB; the
  /// same for all numbers of tiles: plain_6mp -1.0, garden_6mp -0.5.)
  double model_error = 1.25e-3, fewest_tiles = 40;
  double significance = 3;              ///< standard deviations
  double shift_significance = 3.44;     ///< of two components; as rare as 3 of a single number
  double parallax_significance = 3.76;  ///< of three components
  double follow_significance = 2;       ///< of the parallax that shifts foretell; noise reaches 1.4
  int shift_level = 1 << 17;  ///< pixels of a level; in larger ones things may move by more than a tile sees
  /// Of paths that bend in the same sense all over the picture. 102 brackets of still scenes reach 2.9, those
  /// of a camera that turns 3.4, and where a thing moves in a thirtieth of the picture 3.2.
  double bend_significance = 4.5;
  double noticeable = 0.35;      ///< px; a smaller motion is not worth resampling a frame
  double noticeable_roll = 0.1;  ///< px at the corners; a warp without a roll is faster

  // Parallax: how depth moves a pixel.
  int samples = 8;               ///< of depth, a side of a tile
  double least_measured = 0.75;  ///< of a tile
  float smooth = 0.5f;           ///< standard deviations; a tile that spans more holds a depth edge
  double flat = 0.02;            ///< deviation of inverse depth over its mean; such a scene moves as a whole
  int speck = 5;  ///< px of depth; smaller spots of wrong depth show another place (1: planes_6mm -0.35 dB)
  float hidden = 0.5f;  ///< px of parallax between a pixel and what hides it
} kAlignment{};

}  // namespace all_in_focus::core
