// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// CameraInfo and Optics messages, poses. What is accepted can be used.

#include <cmath>

#include "all_in_focus/depth_registration.hpp"
#include "conversions.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

const char* const kModels[] = {"plumb_bob", "rational_polynomial", "", "equidistant"};
constexpr int kMostCoefficients = 16;

// Mostly small, as sizes that are accepted are.
std::uint32_t pixelsFrom(Input& input) {
  return input.flag() ? input.take<std::uint8_t>() : input.take<std::uint32_t>();
}

sensor_msgs::CameraInfo infoFrom(Input& input) {
  sensor_msgs::CameraInfo info;
  for (auto* pixels : {&info.width, &info.height, &info.roi.x_offset, &info.roi.y_offset, &info.roi.width,
                       &info.roi.height, &info.binning_x, &info.binning_y})
    *pixels = pixelsFrom(input);
  for (const int i : {0, 2, 4, 5}) info.K[i] = input.number();
  info.K[8] = 1;
  info.distortion_model = kModels[input.below(std::size(kModels))];
  info.D.resize(input.below(kMostCoefficients));
  for (double& coefficient : info.D) coefficient = input.number();
  return info;
}

void requireUsable(const sensor_msgs::CameraInfo& info) {
  const Camera camera = toCamera(info, "/camera_info");
  validate(camera, "");
  require(static_cast<unsigned>(camera.size.width) <= info.width &&
              static_cast<unsigned>(camera.size.height) <= info.height,
          "images are larger than the sensor");
  constexpr int kMostPixels = 100 * 100;  // more take too long
  if (camera.size.area() > kMostPixels) return;
  const DepthRegistration usable({camera, camera, {}});
}

void run(Input& input) {
  const sensor_msgs::CameraInfo info = infoFrom(input);
  accepts([&] { requireUsable(info); });

  cv::Vec4d q;
  cv::Vec3d t;
  for (double& number : q.val) number = input.number();
  for (double& number : t.val) number = input.number();
  RigidTransform pose;
  if (accepts([&] { pose = RigidTransform::fromQuaternion(q[0], q[1], q[2], q[3], t); })) {
    require(cv::norm(pose.rotation * pose.rotation.t() - cv::Matx33d::eye()) < 1e-9, "the rotation is none");
    for (const double mm : pose.translation_mm.val)
      require(std::isfinite(mm), "the translation is not finite");
  }

  OpticsMsg lens;
  for (double* number : {&lens.focal_length_mm, &lens.aperture, &lens.circle_of_confusion_mm})
    *number = input.number();
  core::Optics optics;
  if (accepts([&] { optics = toOptics(lens); }))
    require(toOptics(toMessage(optics)) == optics, "other optics");
}

Seed seedOf(int size, int binning, int model, const std::vector<double>& coefficients) {
  Seed seed;
  for (const int pixels : {size, size, 2, 3, size - 4, size - 6, binning, binning})
    seed.flag(true).below(pixels);
  for (const double k : {30.5, size / 2.0, 31.0, size / 2.0}) seed.number(k);
  seed.below(model).below(static_cast<int>(coefficients.size()));
  for (const double k : coefficients) seed.number(k);
  for (const double q : {0.01, 0.02, 0.03, 0.99, 0.025, -0.01, 0.001}) seed.number(q);
  return seed.number(24).number(4).number(0.019);
}

std::vector<std::string> seeds() {
  return {seedOf(64, 1, 0, {0.1, -0.2, 0.001, 0.002, 0.3}), seedOf(80, 2, 1, {0.1, 0, 0, 0, 0, 0.1, 0, 0}),
          seedOf(40, 0, 2, {}), seedOf(32, 4, 0, std::vector<double>(8, 0.0)),
          seedOf(16, 1, 3, {1, 2, 3, 4})};
}

const FuzzTarget target("camera_info", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
