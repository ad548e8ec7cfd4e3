// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// The checks for likely mistakes, with any rig, depth and picture.

#include "all_in_focus/rig_checks.hpp"
#include "images.hpp"
#include "rig_warnings.hpp"
#include "rigs.hpp"
#include "target.hpp"

namespace all_in_focus::fuzz {
namespace {

void run(Input& input) {
  const cv::Size depth_size = sizeFrom(input, 255), color_size = sizeFrom(input, 255);
  const cv::Size picture_size = input.flag() ? color_size : sizeFrom(input);
  core::Rig rig;
  rig.depth = cameraFrom(input, depth_size);
  rig.color = cameraFrom(input, color_size);
  const core::Optics optics{input.number(), input.number(), input.number()};
  const auto check = [&] {
    rig.depth_to_color = poseFrom(input);
    validate(optics);
    const cv::Mat depth = depthFrom(input, depth_size);
    const cv::Mat picture = pictureFrom(input, picture_size);
    const RigWarnings found = checkRig(rig, &optics, depth, [&] { return picture; });
    for (const std::string& line : found.lines())
      require(line.find('\n') == std::string::npos, "not one line: " + line);
    checkMirroring(found.registered, cv::Mat(), picture);
  };
  accepts(check);
}

std::vector<std::string> seeds() {
  std::vector<std::string> seeds;
  for (const cv::Size size : {cv::Size(160, 120), {1, 200}, {200, 1}}) {
    for (const double meters : {0.03, 30.0}) {
      Seed seed;
      putSize(putSize(seed, size), size).flag(true);
      putCamera(putCamera(seed, 140, size), 150, size);
      seed.number(24).number(4).number(0.019);
      writePose(seed, 1, {meters, 0, 0});
      putBoxes(seed, 2800, {{{30, 20, 30, 60}, 900}, {{10, 5, 9, 50}, 1200}, {{2, 8, 3, 7}, 0}});
      putPicture(seed, 20, 200, 1);
      seeds.push_back(seed);
    }
  }
  return seeds;
}

const FuzzTarget target("rig_checks", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
