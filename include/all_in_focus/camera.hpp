// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// Pinhole camera with the distortion of ROS' plumb_bob and rational_polynomial models.
struct Camera {
  cv::Size size;                       ///< pixels
  double fx = 0, fy = 0;               ///< pixels
  double cx = 0, cy = 0;               ///< principal point, pixels; pixel centres are integers
  std::array<double, 8> distortion{};  ///< k1 k2 p1 p2 k3 k4 k5 k6, 0 = none

  bool distorted() const;

  /// Radius in the plane z = 1 up to which radial distortion is one-to-one: beyond, the polynomial folds the
  /// world back into the picture. 10 (84 degrees off the axis) where it does not.
  double reach() const;

  /// Ideal to distorted coordinates in the plane z = 1.
  cv::Point2d distort(const cv::Point2d& ideal) const;
  /// Distorted to ideal coordinates in the plane z = 1 (fixed-point iteration, to 1e-9 for usual lenses).
  cv::Point2d undistort(const cv::Point2d& distorted) const;
};

/// Throws std::invalid_argument that names camera and value unless size, fx and fy are positive and all is
/// finite.
void validate(const Camera& camera, const char* name);

/// x_to = R x_from + t, t in mm.
struct RigidTransform {
  cv::Matx33d rotation = cv::Matx33d::eye();
  cv::Vec3d translation_mm;

  /// From a quaternion (normalised here; throws std::invalid_argument if it is zero or not finite) and
  /// metres.
  static RigidTransform fromQuaternion(double x, double y, double z, double w,
                                       const cv::Vec3d& translation_m);
};

/// Depth and colour camera, rigidly mounted. Optical frames: X right, Y down, Z forward.
struct Rig {
  Camera depth;
  Camera color;
  RigidTransform depth_to_color;
};

bool operator==(const Camera& a, const Camera& b);
bool operator==(const Rig& a, const Rig& b);

}  // namespace all_in_focus::core
