// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "rig_checks.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <stdexcept>

namespace all_in_focus {
namespace {

using namespace core;

constexpr double kFarApart = 2.0;        // m between the cameras; more are probably mm
constexpr double kRotated = 60;          // degrees; more are probably other axes
constexpr double kLittleOverlap = 0.05;  // share of the picture
constexpr int kProbablyMetres = 20;      // mm

std::string checkPose(const RigidTransform& pose) {
  const double distance = cv::norm(pose.translation_mm) / 1000;
  const double cosine = std::clamp((cv::trace(pose.rotation) - 1) / 2, -1.0, 1.0);
  const double angle = std::acos(cosine) * 180 / CV_PI;
  const std::string where = cv::format(
      "the depth camera stands %.4g m from the colour camera, rotated by %.3g degrees", distance, angle);
  if (distance > kFarApart) return where + ": are these mm?";
  if (angle > kRotated) {
    return where + ": is it between the optical frames (Z forward, Y down), and the quaternion x, y, z, w?";
  }
  return "";
}

std::string checkUnit(const cv::Mat& depth) {
  std::vector<std::uint16_t> known;
  for (int y = 0; y < depth.rows; ++y) {
    const auto* row = depth.ptr<std::uint16_t>(y);
    std::copy_if(row, row + depth.cols, std::back_inserter(known), [](std::uint16_t d) { return d > 0; });
  }
  if (known.empty()) return "";
  const auto middle = known.begin() + (known.size() - 1) / 2;
  std::nth_element(known.begin(), middle, known.end());
  if (*middle > kProbablyMetres) return "";
  return cv::format("half of the depths are %d or less: m, but a depth image means mm: multiply by 1000",
                    *middle);
}

std::string checkOverlap(const Rig& rig, const cv::Mat& depth) {
  cv::Mat registered;
  DepthRegistration(rig).compute(depth, registered);
  const double share =
      static_cast<double>(cv::countNonZero(registered)) / static_cast<double>(registered.total());
  const std::string remedy = "check the transform and both calibrations";
  if (share == 0) throw std::invalid_argument("no depth falls into the colour picture: " + remedy);
  if (share >= kLittleOverlap) return "";
  return cv::format("only %.2g %% of the colour picture gets a depth: ", 100 * share) + remedy +
         ", and whether the sensor sees the scene";
}

std::string checkCircleOfConfusion(const Optics& optics, const Camera& color) {
  const double sensor_mm = optics.focal_length_mm * color.size.width / color.fx;
  if (optics.circle_of_confusion_mm <= sensor_mm / 50) return "";
  return cv::format(
      "the circle of confusion, %g mm, is over a fiftieth of the sensor, which is %.3g mm wide: is it in "
      "another unit?",
      optics.circle_of_confusion_mm, sensor_mm);
}

}  // namespace

std::vector<std::string> checkRig(const PipelineInput& input) {
  std::vector<std::string> warnings;
  const auto add = [&warnings](const std::string& warning) {
    if (!warning.empty()) warnings.push_back(warning);
  };
  const cv::Mat& any_depth = input.depth.empty() ? input.registered_depth : input.depth;
  if (!any_depth.empty()) add(checkUnit(any_depth));
  if (!input.has_rig) return warnings;
  if (!any_depth.empty()) add(checkCircleOfConfusion(input.optics, input.rig.color));
  if (input.depth.empty()) return warnings;
  add(checkPose(input.rig.depth_to_color));
  add(checkOverlap(input.rig, input.depth));
  return warnings;
}

}  // namespace all_in_focus
