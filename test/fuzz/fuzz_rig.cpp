// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// The four YAML files of a rig folder. A rig that is accepted can be used.

#include <cmath>

#include "all_in_focus/depth_registration.hpp"
#include "rig_files.hpp"
#include "scratch_folder.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

constexpr char kMark = '\f';  // between the files

const std::string kCamera =
    "image_width: 32\nimage_height: 24\ncamera_name: one\n"
    "camera_matrix: {rows: 3, cols: 3, data: [30.5, 0, 16.1, 0, 31.0, 12, 0, 0, 1]}\n";
const std::string kPlumbBob =
    kCamera +
    "distortion_model: plumb_bob\n"
    "distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -2e-1, 0.001, 0, .0]}\n";
const std::string kRational =
    kCamera +
    "distortion_model: rational_polynomial\n"
    "distortion_coefficients:\n  rows: 1\n  data: [0.1, -0.2, 0.001, 0.002, 0.05, 0.1, 0.2, 0.3]\n";
const std::string kFisheye = kCamera +
                             "camera_model: fisheye\nbinning_x: 1\ndistortion_model: equidistant\n"
                             "distortion_coefficients: {rows: 1, cols: 4, data: [0.1, -0.02, 0.001, 0.0]}\n";
const std::string kPose = "translation: [0.025, -0.01, 1.0e-3]\nrotation: [0.0, 0.0, 0.0436194, 0.9990482]\n";
const std::string kOptics = "focal_length_mm: 24.0\naperture: 4.0\ncircle_of_confusion_mm: 0.019\n";

void requireUsable(const Rig& rig) {
  for (const Camera* camera : {&rig.depth, &rig.color}) validate(*camera, "");
  const cv::Matx33d& R = rig.depth_to_color.rotation;
  require(cv::norm(R * R.t() - cv::Matx33d::eye()) < 1e-9, "the rotation is none");
  for (const double t : rig.depth_to_color.translation_mm.val) require(std::isfinite(t), "no translation");
  constexpr int kMostPixels = 64 * 64;  // more take too long
  if (rig.depth.size.width > kMostPixels || rig.depth.size.height > kMostPixels) return;
  if (rig.depth.size.area() > kMostPixels) return;
  const DepthRegistration usable(rig);
}

void run(Input& input) {
  static const ScratchFolder folder;
  for (const char* name : {"depth.yaml", "color.yaml", "extrinsics.yaml", "optics.yaml"})
    folder.write(name, input.numberUpTo(kMark));
  Rig rig;
  if (accepts([&] { rig = readRig(folder.path()); })) requireUsable(rig);
  core::Optics optics;
  if (accepts([&] { optics = readOptics(folder.path()); })) validate(optics);
}

std::string filesOf(const std::string& depth, const std::string& color, const std::string& pose,
                    const std::string& optics) {
  return depth + kMark + color + kMark + pose + kMark + optics;
}

std::vector<std::string> seeds() {
  return {filesOf(kFisheye, kFisheye, kPose, kOptics), filesOf(kCamera, kPlumbBob, kPose, kOptics),
          filesOf(kRational, kCamera, kPose, kOptics),
          filesOf(kPlumbBob, kRational, "translation: [0, 0, 0]\nrotation: [0, 0, 0, 1]\n",
                  "{focal_length_mm: 50, aperture: 1.8, circle_of_confusion_mm: 3e-2}"),
          filesOf("image_width: 99999\nimage_height: -1\ncamera_matrix: &a {data: [*a, .nan, .inf, -.inf]}",
                  "[[[{a: [}", "--- !!binary |\n  aGFsbG8=\n...\n%YAML 1.2", "'\\x00\": ? - \"\\u263a\"")};
}

const FuzzTarget target("rig", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
