// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// Where a point p of one frame of a bracket lies in another:
///   p' = center + scale R(angle) (p - center) + shift, pixels.
/// Refocusing changes the magnification, a knock shifts the picture, and a tripod head that sags rolls it.
struct SimilarityTransform {
  double scale = 1;
  cv::Point2d shift;
  double angle = 0;  ///< radians, from x towards y

  bool isIdentity() const { return scale == 1 && shift == cv::Point2d() && angle == 0; }

  /// Where p lies.
  cv::Point2d apply(const cv::Point2d& p, const cv::Point2d& center) const;
  /// The same as a matrix: matrix * (x, y, 1).
  cv::Matx23d matrix(const cv::Point2d& center) const;
};

/// Where a point p of the reference that has the relief n (see Relief) lies in a frame of a camera that has
/// moved:
///   p' + (turn_x x + turn_y y) (x, y) + n (parallax_x + parallax_z x, parallax_y + parallax_z y)
/// p' by the similarity transform, (x, y) = (p - center) / r, r half the diagonal of the picture. To first
/// order this is what a camera with focal length f sees that moved by t and turned by w (Longuet-Higgins and
/// Prazdny 1980):
///   turn = r^2 / f (-w_y, w_x),
///   parallax = s (-f t_x, -f t_y, r t_z),  s the standard deviation of inverse depth,
/// while scale, angle and shift hold what turns, the lens and the mean inverse depth move.
struct CameraMotion : SimilarityTransform {
  cv::Vec2d turn{};      ///< px: by how much more the corners move than the middle
  cv::Vec3d parallax{};  ///< px

  bool hasParallax() const { return parallax != cv::Vec3d(); }
  bool isSimilarity() const { return turn == cv::Vec2d() && !hasParallax(); }
  bool isIdentity() const { return SimilarityTransform::isIdentity() && isSimilarity(); }
  cv::Point2d apply(const cv::Point2d& p, double relief, const cv::Point2d& center,
                    const cv::Size& size) const;
  /// The same without parallax, to first order of the turn: homography * (x, y, 1).
  cv::Matx33d homography(const cv::Point2d& center, const cv::Size& size) const;
};

/// First `first`, then `second`, both about the same centre.
SimilarityTransform compose(const SimilarityTransform& first, const SimilarityTransform& second);

SimilarityTransform inverse(const SimilarityTransform& transform);

/// How far the transform moves any point of a picture at most, pixels.
double largestDisplacement(const SimilarityTransform& transform, const cv::Size& size,
                           const cv::Point2d& center);

/// A rectangle of the reference all of whose pixels a frame of that size shows; empty if it shows none.
/// motion: from the reference to the frame.
cv::Rect seenThrough(const SimilarityTransform& motion, const cv::Size& size, const cv::Point2d& center);

}  // namespace all_in_focus::core
