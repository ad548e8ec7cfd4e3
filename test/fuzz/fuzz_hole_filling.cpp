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
  for (int i = 0; i < 2; ++i) {
    const cv::Mat depth = depthFrom(input, sizeFrom(input));
    cv::Mat dilated, filled;
    if (!accepts([&] { dilateDepth(depth, dilated); })) {
      require(depth.empty(), "refused");
      continue;
    }
    require(isSame(dilated, referenceDilation(depth)), "dilation not as defined");
    fillFromFarSide(depth, filled);
    require(isSame(filled, referenceFarSide(depth)), "far side not as defined");
    cv::Mat diffused = depth.clone();
    fillByDiffusion(diffused);
    require(isSame(diffused, referenceDiffusion(depth.clone())), "diffusion not as defined");
  }
}

std::vector<std::string> seeds() {
  Seed seed;
  putBoxes(putSize(seed, {40, 30}), 1500, {{{5, 5, 9, 20}, 0}, {{12, 0, 4, 30}, 1200}, {{20, 9, 20, 3}, 0}});
  putNoise(putSize(seed, {64, 17}), 0, 4);
  return {seed};
}

const FuzzTarget target("hole_filling", run, seeds);

}  // namespace
}  // namespace all_in_focus::fuzz
