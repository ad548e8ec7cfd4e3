// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "all_in_focus/camera.hpp"
#include "input.hpp"

namespace all_in_focus::fuzz {

/// Any camera, also an impossible one.
inline core::Camera cameraFrom(Input& input, const cv::Size& size) {
  core::Camera camera;
  camera.size = size;
  for (double* number : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *number = input.number();
  for (int i = input.below(9); i > 0; --i) camera.distortion[i - 1] = input.number();
  return camera;
}

inline Seed& putCamera(Seed& seed, double f, const cv::Size& size,
                       const std::array<double, 5>& distortion = {}) {
  seed.number(f).number(1.01 * f).number(0.49 * size.width).number(0.52 * size.height);
  const int count = distortion[0] != 0 ? 5 : 0;
  seed.below(count);
  for (int i = count; i > 0; --i) seed.number(distortion[i - 1]);
  return seed;
}

/// Any pose. Throws std::invalid_argument.
inline core::RigidTransform poseFrom(Input& input) {
  double q[4], t[3];
  for (double& number : q) number = input.number();
  for (double& number : t) number = input.number();
  return core::RigidTransform::fromQuaternion(q[0], q[1], q[2], q[3], {t[0], t[1], t[2]});
}

inline Seed& writePose(Seed& seed, double roll_degrees, const cv::Vec3d& translation_m) {
  const double half = roll_degrees * CV_PI / 360;
  seed.number(0.01).number(-0.008).number(std::sin(half)).number(std::cos(half));
  for (const double t : translation_m.val) seed.number(t);
  return seed;
}

}  // namespace all_in_focus::fuzz
