// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "rig_warnings.hpp"

#include <stdexcept>

#include "all_in_focus/depth_registration.hpp"
#include "all_in_focus/rig_checks.hpp"

namespace all_in_focus {

std::vector<std::string> RigWarnings::lines() const {
  std::vector<std::string> lines;
  for (const std::string& line :
       {unit, circle_of_confusion, depth_center, color_center, pose, overlap, mirroring}) {
    if (!line.empty()) lines.push_back(line);
  }
  return lines;
}

RigWarnings checkRig(const Rig& rig, const Optics* optics, const cv::Mat& depth,
                     const std::function<cv::Mat()>& picture) {
  RigWarnings found;
  found.unit = checkDepthUnit(depth);
  if (optics) found.circle_of_confusion = checkCircleOfConfusion(*optics, rig.color);
  found.depth_center = checkPrincipalPoint(rig.depth, "depth");
  found.color_center = checkPrincipalPoint(rig.color, "colour");
  found.pose = checkPose(rig.depth_to_color);
  DepthRegistration registration(rig);
  registration.compute(depth, found.registered);
  try {
    found.overlap = checkCoverage(found.registered, rig);
  } catch (const std::invalid_argument& e) {
    found.overlap = e.what();
    found.apart = true;
    return found;
  }
  cv::Mat flipped, mirrored;
  cv::flip(depth, flipped, 1);
  registration.compute(flipped, mirrored);
  found.mirroring = checkMirroring(found.registered, mirrored, picture());
  return found;
}

}  // namespace all_in_focus
