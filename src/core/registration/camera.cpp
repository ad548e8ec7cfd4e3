// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/camera.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>

namespace all_in_focus::core {
namespace {

constexpr int kUndistortIterations = 50;
constexpr double kUndistortTolerance = 1e-12;

// What a camera can have, and pixels that single precision can compute with.
constexpr double kLeastFocalLength = 0.01, kMostFocalLength = 1e7;  // pixels
constexpr double kMostPrincipalPoint = 1e6;                         // pixels, either way
constexpr double kMostDistortion = 1e6;                             // of a coefficient, either way
constexpr double kLargestSkew = 0.1;  // pixels; moves no corner by a tenth of a pixel

// theta (1 + k1 theta^2 + .. + k4 theta^8): how far from the middle a fisheye lens shows a ray that comes
// theta off its axis, in focal lengths.
double fisheyeRadius(const std::array<double, 8>& k, double theta) {
  const double t2 = theta * theta;
  return theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
}

double fisheyeSlope(const std::array<double, 8>& k, double theta) {
  const double t2 = theta * theta;
  return 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])));
}

cv::Point2d undistortFisheye(const std::array<double, 8>& k, const cv::Point2d& distorted) {
  const double radius = std::hypot(distorted.x, distorted.y);
  if (radius == 0) return distorted;
  double theta = std::min(radius, CV_PI / 2), error = 0;
  for (int i = 0; i < kUndistortIterations; ++i) {
    error = fisheyeRadius(k, theta) - radius;
    if (std::abs(error) < kUndistortTolerance) break;
    theta = std::clamp(theta - error / fisheyeSlope(k, theta), 0.0, CV_PI);
  }
  const bool found = std::abs(error) < 1e-9 && theta < CV_PI / 2;
  return distorted * (found ? std::tan(theta) / radius : std::numeric_limits<double>::quiet_NaN());
}

}  // namespace

bool Camera::distorted() const {
  return lens == LensModel::kEquidistant ||
         std::any_of(distortion.begin(), distortion.end(), [](double k) { return k != 0; });
}

cv::Point2d Camera::distort(const cv::Point2d& ideal) const {
  if (lens == LensModel::kEquidistant) {
    const double radius = std::hypot(ideal.x, ideal.y);
    return radius == 0 ? ideal : ideal * (fisheyeRadius(distortion, std::atan(radius)) / radius);
  }
  const auto& [k1, k2, p1, p2, k3, k4, k5, k6] = distortion;
  const double x = ideal.x, y = ideal.y, r2 = x * x + y * y;
  const double radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)));
  return {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
          y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
}

double Camera::reach() const {
  constexpr double kStep = 0.01, kMost = 10;
  Camera radial = *this;
  if (lens == LensModel::kPolynomial) radial.distortion[2] = radial.distortion[3] = 0;
  double radius = 0, image_radius = 0;
  while (radius < kMost) {
    const double r = radius + kStep, next = radial.distort({r, 0}).x;
    if (!(next > image_radius)) break;
    radius = r;
    image_radius = next;
  }
  return radius;
}

cv::Point2d Camera::undistort(const cv::Point2d& distorted) const {
  if (lens == LensModel::kEquidistant) return undistortFisheye(distortion, distorted);
  cv::Point2d ideal = distorted;
  for (int i = 0; i < kUndistortIterations; ++i) {
    const cv::Point2d error = distort(ideal) - distorted;
    ideal -= error;
    if (std::abs(error.x) + std::abs(error.y) < kUndistortTolerance) break;
  }
  return ideal;
}

cv::Point2d Camera::ray(const cv::Point2d& pixel) const {
  const cv::Point2d seen((pixel.x - cx) / fx, (pixel.y - cy) / fy);
  return distorted() ? undistort(seen) : seen;
}

void Camera::setMatrix(const double* matrix) {
  fx = matrix[0], cx = matrix[2], fy = matrix[4], cy = matrix[5];
  if (fx == 0 || fy == 0) return;  // not calibrated, as validate() says
  if (!(std::abs(matrix[1]) <= kLargestSkew)) {
    throw std::invalid_argument(cv::format(
        "the camera matrix has a skew, %g, which is not supported: calibrate without one", matrix[1]));
  }
  if (matrix[3] != 0 || matrix[6] != 0 || matrix[7] != 0 || matrix[8] != 1)
    throw std::invalid_argument("the camera matrix must be fx 0 cx, 0 fy cy, 0 0 1");
}

void Camera::setDistortion(const std::string& model, const std::vector<double>& coefficients) {
  distortion = {};
  lens = LensModel::kPolynomial;
  if (model.empty()) return;
  static const std::map<std::string, std::size_t> kMost = {
      {"plumb_bob", 5}, {"rational_polynomial", 8}, {"equidistant", 4}};
  const auto found = kMost.find(model);
  if (found == kMost.end()) {
    throw std::invalid_argument("distortion model \"" + model +
                                "\" is not supported: use plumb_bob, rational_polynomial or equidistant");
  }
  const std::size_t most = found->second, count = coefficients.size();
  const auto known = {0, 4, 5, 8, 12, 14};
  const bool is_known = std::find(known.begin(), known.end(), static_cast<int>(count)) != known.end();
  const std::size_t used = std::min(most, count);
  const bool is_padded = std::all_of(coefficients.begin() + static_cast<std::ptrdiff_t>(used),
                                     coefficients.end(), [](double k) { return k == 0; });
  if (!is_known || !is_padded) {
    throw std::invalid_argument(model + " has " + std::to_string(most) + " distortion coefficients, not " +
                                std::to_string(count) + ": calibrate again");
  }
  std::copy_n(coefficients.begin(), used, distortion.begin());
  if (model == "equidistant") lens = LensModel::kEquidistant;
}

void validate(const Camera& camera, const char* name) {
  const auto fail = [&](const std::string& what) {
    throw std::invalid_argument(std::string(name) + " camera: " + what);
  };
  if (camera.size.width <= 0 || camera.size.height <= 0) {
    fail(cv::format("image size is %dx%d", camera.size.width, camera.size.height));
  }
  for (const double f : {camera.fx, camera.fy}) {
    if (f >= kLeastFocalLength && f <= kMostFocalLength) continue;
    fail(cv::format("fx = %g, fy = %g: not calibrated (both must be %g to %g pixels)", camera.fx, camera.fy,
                    kLeastFocalLength, kMostFocalLength));
  }
  for (const double c : {camera.cx, camera.cy}) {
    if (std::abs(c) <= kMostPrincipalPoint) continue;
    fail(cv::format("principal point is %g, %g: at most %g pixels either way are possible", camera.cx,
                    camera.cy, kMostPrincipalPoint));
  }
  for (const double k : camera.distortion) {
    if (std::abs(k) <= kMostDistortion) continue;
    fail(cv::format("a distortion coefficient is %g: at most %g either way is possible", k, kMostDistortion));
  }
}

RigidTransform RigidTransform::fromQuaternion(double x, double y, double z, double w,
                                              const cv::Vec3d& translation_m) {
  const double norm = std::sqrt(x * x + y * y + z * z + w * w);
  if (!(std::isfinite(norm) && norm > 1e-6)) {
    throw std::invalid_argument("pose of the depth camera: the rotation quaternion is zero or not finite");
  }
  x /= norm, y /= norm, z /= norm, w /= norm;
  RigidTransform pose;
  pose.rotation = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                   2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                   2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
  pose.translation_mm = translation_m * 1000.0;
  for (const double t : pose.translation_mm.val) {
    if (!std::isfinite(t))
      throw std::invalid_argument("pose of the depth camera: the translation is not finite");
  }
  return pose;
}

bool operator==(const Camera& a, const Camera& b) {
  return a.size == b.size && a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy &&
         a.distortion == b.distortion && a.lens == b.lens;
}

bool operator==(const Rig& a, const Rig& b) {
  return a.depth == b.depth && a.color == b.color && a.depth_to_color.rotation == b.depth_to_color.rotation &&
         a.depth_to_color.translation_mm == b.depth_to_color.translation_mm;
}

}  // namespace all_in_focus::core
