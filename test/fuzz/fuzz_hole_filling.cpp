// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Dilation and both fillings of tiny depth images, compared with their plain definitions.

#include "all_in_focus/hole_filling.hpp"
#include "images.hpp"
#include "target.hpp"
#include "unit/reference_depth.hpp"

namespace all_in_focus::fuzz {
namespace {

using namespace core;

void run(Input& input) {
  DiffusionFilling diffusion;
  if (input.flag()) {
    diffusion.lambda = input.number();
    diffusion.conduction_mm = input.number();
    diffusion.hole_below_mm = input.take<std::int32_t>();
  }
  FarSideFilling far_side;
  for (int i = 0; i < 2; ++i) {
    const cv::Mat depth = depthFrom(input, sizeFrom(input));
    cv::Mat dilated, filled;
    if (!accepts([&] { dilateDepth(depth, dilated); })) {
      require(depth.empty(), "refused");
      continue;
    }
    require(isSame(dilated, referenceDilation(depth)), "dilation not as defined");
    far_side.fill(depth, filled);
    require(isSame(filled, referenceFarSide(depth)), "far side not as defined");
    cv::Mat diffused = depth.clone();
    if (accepts([&] { diffusion.fill(diffused); }))
      require(isSame(diffused, referenceDiffusion(depth.clone(), diffusion)), "diffusion not as defined");
  }
}

std::vector<std::string> seeds() {
  std::vector<std::string> seeds;
  for (const auto& [lambda, conduction] : {std::pair(0.25, 25.0), {0.1, 0.3}, {0.2, 20000.0}}) {
    for (const int hole_below : {10, 1011, 65535}) {
      Seed seed;
      seed.flag(true).number(lambda).number(conduction).put<std::int32_t>(hole_below);
      putBoxes(putSize(seed, {40, 30}), 1500,
               {{{5, 5, 9, 20}, 0}, {{12, 0, 4, 30}, 1200}, {{20, 9, 20, 3}, 0}});
      putNoise(putSize(seed, {64, 17}), 0, 4);
      seeds.push_back(seed);
    }
  }
  return seeds;
}

const FuzzTarget target("hole_filling", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
