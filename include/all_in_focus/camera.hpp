// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace all_in_focus::core {

/// How a lens bends the rays of a pinhole camera.
enum class LensModel {
  kPolynomial,   ///< ROS' plumb_bob and rational_polynomial: k1 k2 p1 p2 k3 k4 k5 k6
  kEquidistant,  ///< ROS' equidistant, OpenCV's fisheye: k1 k2 k3 k4
};

/// Pinhole camera with distortion.
struct Camera {
  cv::Size size;                       ///< pixels
  double fx = 0;                       ///< focal length along x, pixels
  double fy = 0;                       ///< focal length along y, pixels
  double cx = 0;                       ///< principal point, pixels; centres of pixels are integers
  double cy = 0;                       ///< principal point, pixels
  std::array<double, 8> distortion{};  ///< coefficients, see LensModel; 0 = none
  LensModel lens = LensModel::kPolynomial;

  bool distorted() const;  ///< false: distort() changes nothing

  /// Greatest radius in the plane z = 1 up to which the radial distortion is one-to-one; 10 (84 degrees off
  /// the axis) if it is beyond that. Farther out the polynomial maps points back into the picture, where they
  /// do not belong.
  double reach() const;

  /// Distorts a point of the plane z = 1.
  cv::Point2d distort(const cv::Point2d& ideal) const;
  /// Inverse of distort(), by iteration; exact to 1e-9 for usual lenses. NaN for a point that a fisheye lens
  /// sees 90 degrees off its axis or more.
  cv::Point2d undistort(const cv::Point2d& distorted) const;
  /// Where the ray of a pixel meets the plane z = 1 (equation 1).
  cv::Point2d ray(const cv::Point2d& pixel) const;

  /// Sets fx, fy, cx, cy from the nine numbers of a camera matrix, row by row. Throws std::invalid_argument
  /// where it says more than those four, such as a skew: nothing here would use it.
  void setMatrix(const double* matrix);

  /// Sets the distortion from ROS' models plumb_bob (up to 5 coefficients), rational_polynomial (up to 8),
  /// equidistant (4) and "" (none). Their number has to be one that OpenCV knows (0, 4, 5, 8, 12, 14);
  /// drivers pad with zeros. Throws std::invalid_argument for other models and numbers, and where a
  /// coefficient beyond the model is not 0.
  void setDistortion(const std::string& model, const std::vector<double>& coefficients);
};

/// Throws std::invalid_argument unless the image has a size and all values are what a camera can have. The
/// message begins with `name` and gives the value.
void validate(const Camera& camera, const char* name);

/// x_to = R x_from + t, t in mm.
struct RigidTransform {
  cv::Matx33d rotation = cv::Matx33d::eye();  ///< R
  cv::Vec3d translation_mm;                   ///< t

  /// From a quaternion, which need not be normalised, and a translation in metres. Throws
  /// std::invalid_argument if the quaternion is zero or a number is not finite.
  static RigidTransform fromQuaternion(double x, double y, double z, double w,
                                       const cv::Vec3d& translation_m);
};

/// Depth and colour camera, rigidly mounted. Optical frames: X right, Y down, Z forward.
struct Rig {
  Camera depth;                   ///< depth sensor
  Camera color;                   ///< camera of the focus bracket
  RigidTransform depth_to_color;  ///< pose of the depth camera in the colour camera's frame
};

bool operator==(const Camera& a, const Camera& b);
bool operator==(const Rig& a, const Rig& b);

}  // namespace all_in_focus::core
