// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "restoration/image_formation.hpp"
#include "restoration/observed_bracket.hpp"

namespace all_in_focus::core {

/// Moves the jumps of a depth map to where they explain the frames: pixels beside a jump take a neighbour's
/// inverse depth if the two frames that should be sharpest there are then predicted better, and the jump lies
/// at a colour edge. inverse_depth: in place, shared by `formation` (one for each frame). stiffness: factor
/// on the cost of jumps. Stiff contours (2) keep to colour edges, even where the rim of a near object hides
/// more than the lens model predicts; loose ones (1) follow thin objects. False when proceed said stop.
bool moveContours(const ObservedBracket& bracket, std::vector<ImageFormation>& formation,
                  cv::Mat1f& inverse_depth, float stiffness, const std::function<bool(double)>& proceed);

}  // namespace all_in_focus::core
