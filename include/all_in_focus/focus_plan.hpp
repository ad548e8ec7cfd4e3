// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "all_in_focus/optics.hpp"

namespace all_in_focus::core {

/// Depths from..to, mm; 0 < min <= max, max may be infinite.
struct DepthRange {
  double min_mm = 0;
  double max_mm = 0;
};

/// One exposure: where the lens is focused and what is sharp then (equations 9 and 10), mm. `focus_mm` and
/// `far_mm` may be infinite.
struct PlannedFocus {
  double focus_mm = 0;
  double near_mm = 0;
  double far_mm = 0;
};

/// The fewest exposures with which every range is sharp all over, near to far. A range deeper than one depth
/// of field gets several. Throws std::invalid_argument on impossible optics, and on ranges that are empty or
/// do not lie beyond the focal length.
std::vector<PlannedFocus> planFocus(const Optics& optics, std::vector<DepthRange> ranges);

}  // namespace all_in_focus::core
