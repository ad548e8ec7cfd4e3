// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/scene_points.hpp"

#include <cmath>
#include <cstdint>
#include <limits>

namespace all_in_focus::core {
namespace {

constexpr double kMmPerM = 1000;
constexpr double kSteepest = 1e6;  // of a ray; no lens sees farther out

// Place of pixel i of n among m pixels of the same picture.
double scaled(int i, int n, int m) {
  return (i + 0.5) * m / n - 0.5;
}

}  // namespace

void scenePoints(const cv::Mat& depth, const cv::Size& size, const Camera& camera, int y, cv::Vec3f* points) {
  const auto* mm = depth.ptr<std::uint16_t>(cvRound(scaled(y, size.height, depth.rows)));
  const double v = scaled(y, size.height, camera.size.height);
  for (int x = 0; x < size.width; ++x) {
    points[x] = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());
    const double z = mm[cvRound(scaled(x, size.width, depth.cols))] / kMmPerM;
    if (z == 0) continue;
    const cv::Point2d ray = camera.ray({scaled(x, size.width, camera.size.width), v});
    if (std::abs(ray.x) + std::abs(ray.y) < kSteepest) points[x] = cv::Vec3d(ray.x * z, ray.y * z, z);
  }
}

}  // namespace all_in_focus::core
