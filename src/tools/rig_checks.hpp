// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "all_in_focus/pipeline.hpp"

namespace all_in_focus {

/// Looks for values that are possible but most likely a mistake, such as mm in the place of m, in the words
/// of check_bag: distance and rotation between the cameras, unit of depth, share of the colour picture that
/// gets a depth, circle of confusion. Returns a line for each, with the remedy. Throws std::invalid_argument
/// if no depth falls into the colour picture.
std::vector<std::string> checkRig(const core::PipelineInput& input);

}  // namespace all_in_focus
