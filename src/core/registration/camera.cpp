// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/camera.hpp"

#include <algorithm>
#include <cmath>
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

}  // namespace

bool Camera::distorted() const {
  return std::any_of(distortion.begin(), distortion.end(), [](double k) { return k != 0; });
}

cv::Point2d Camera::distort(const cv::Point2d& ideal) const {
  const auto& [k1, k2, p1, p2, k3, k4, k5, k6] = distortion;
  const double x = ideal.x, y = ideal.y, r2 = x * x + y * y;
  const double radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)));
  return {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
          y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
}

double Camera::reach() const {
  constexpr double kStep = 0.01, kMost = 10;
  const double k1 = distortion[0], k2 = distortion[1], k3 = distortion[4], k4 = distortion[5],
               k5 = distortion[6], k6 = distortion[7];
  double radius = 0, image_radius = 0;
  while (radius < kMost) {
    const double r = radius + kStep, r2 = r * r;
    const double next = r * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)));
    if (!(next > image_radius)) break;
    radius = r;
    image_radius = next;
  }
  return radius;
}

cv::Point2d Camera::undistort(const cv::Point2d& distorted) const {
  cv::Point2d ideal = distorted;
  for (int i = 0; i < kUndistortIterations; ++i) {
    const cv::Point2d error = distort(ideal) - distorted;
    ideal -= error;
    if (std::abs(error.x) + std::abs(error.y) < kUndistortTolerance) break;
  }
  return ideal;
}

std::array<double, 8> distortionOf(const std::string& model, const std::vector<double>& coefficients) {
  std::array<double, 8> distortion{};
  if (model.empty()) return distortion;
  const bool is_rational = model == "rational_polynomial";
  if (!is_rational && model != "plumb_bob") {
    throw std::invalid_argument("distortion model \"" + model +
                                "\" is not supported: use plumb_bob or rational_polynomial");
  }
  const std::size_t most = is_rational ? 8 : 5, count = coefficients.size();
  const auto known = {0, 4, 5, 8, 12, 14};
  const bool is_known = std::find(known.begin(), known.end(), static_cast<int>(count)) != known.end();
  const std::size_t used = std::min(most, count);
  const bool is_padded = std::all_of(coefficients.begin() + static_cast<std::ptrdiff_t>(used),
                                     coefficients.end(), [](double k) { return k == 0; });
  if (!is_known || !is_padded) {
    throw std::invalid_argument(model + " has " + std::to_string(most) + " distortion coefficients, not " +
                                std::to_string(count) +
                                ": calibrate again with plumb_bob or rational_polynomial");
  }
  std::copy_n(coefficients.begin(), used, distortion.begin());
  return distortion;
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
         a.distortion == b.distortion;
}

bool operator==(const Rig& a, const Rig& b) {
  return a.depth == b.depth && a.color == b.color && a.depth_to_color.rotation == b.depth_to_color.rotation &&
         a.depth_to_color.translation_mm == b.depth_to_color.translation_mm;
}

}  // namespace all_in_focus::core
