// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>

#include "restoration/disc_blur.hpp"
#include "restoration/observed_bracket.hpp"

namespace all_in_focus::core {

/// How much the frames are blurred where depth was measured, far from holes and jumps: measured radius over
/// that which the optics predict; 0: unknown, for lack of depth or texture. The bracket must have depth.
double measureBlurScale(const ObservedBracket& bracket, const BlurredPictures& pictures);

/// Index of the least of `count` costs, refined to a fraction by a parabola through it and its neighbours.
template <typename Cost>
double lowest(const Cost* costs, int count) {
  const int i = static_cast<int>(std::min_element(costs, costs + count) - costs);
  if (i == 0 || i == count - 1) return i;
  const double curvature = costs[i - 1] - 2.0 * costs[i] + costs[i + 1];
  return curvature > 0 ? i + (costs[i - 1] - costs[i + 1]) / (2 * curvature) : i;
}

}  // namespace all_in_focus::core
