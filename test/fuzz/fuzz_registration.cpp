// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Registration of tiny depth images by any rig, compared with its plain definition.

#include "all_in_focus/depth_registration.hpp"
#include "images.hpp"
#include "rigs.hpp"
#include "target.hpp"
#include "unit/reference_depth.hpp"

namespace all_in_focus::fuzz {
namespace {

using namespace core;

void compare(Input& input) {
  const ThreadsFrom threads(input);
  const Splat splat = input.flag() ? Splat::kFootprint : Splat::kPoint;
  const cv::Size depth_size = sizeFrom(input), color_size = sizeFrom(input);
  Rig rig;
  rig.depth = cameraFrom(input, depth_size);
  rig.color = cameraFrom(input, color_size);
  rig.depth_to_color = poseFrom(input);
  DepthRegistration registration(rig, splat);
  const ReferenceRegistration reference(rig, splat);
  cv::Mat registered;
  for (int i = 0; i < 2; ++i) {  // buffers go on from image to image
    const cv::Mat depth = depthFrom(input, depth_size);
    registration.compute(depth, registered);
    require(isSame(registered, reference.compute(depth)), "not as defined");
  }
}

void run(Input& input) {
  accepts([&] { compare(input); });
}

std::vector<std::string> seeds() {
  std::vector<std::string> seeds;
  const cv::Size depth(40, 33);
  for (const bool footprint : {false, true}) {
    for (const double scale : {0.4, 1.0, 1.5}) {
      for (const double degrees : {0.0, 7.0, 90.0}) {
        const cv::Size color(cvRound(scale * depth.width), cvRound(scale * depth.height));
        Seed seed;
        seed.below(degrees == 7 ? 7 : 0);
        putSize(putSize(seed.flag(footprint), depth), color);
        putCamera(
            seed, 35, depth,
            degrees > 0 ? std::array<double, 5>{-0.2, 0.05, 0.001, -0.002, 0.01} : std::array<double, 5>{});
        putCamera(
            seed, 40 * scale, color,
            degrees == 7 ? std::array<double, 5>{0.1, -0.2, 0.001, -0.002, 0.05} : std::array<double, 5>{});
        writePose(seed, degrees, {-0.03, 0.05, 0.04});
        putBoxes(seed, 2800, {{{5, 5, 12, 10}, 900}, {{2, 8, 3, 7}, 0}});
        putNoise(seed, 500, 4000);
        seeds.push_back(seed);
      }
    }
  }
  return seeds;
}

const FuzzTarget target("registration", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
