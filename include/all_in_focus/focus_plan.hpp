// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "all_in_focus/optics.hpp"

namespace all_in_focus::core {

/// A range of depths, 0 < min <= max.
struct DepthRange {
  double min_mm = 0;  ///< nearest, mm
  double max_mm = 0;  ///< farthest, mm; may be infinite
};

/// One exposure, and what is sharp in it (equations 9 and 10).
struct PlannedFocus {
  double focus_mm = 0;  ///< focus distance, mm; may be infinite
  double near_mm = 0;   ///< nearest sharp depth, mm
  double far_mm = 0;    ///< farthest sharp depth, mm; may be infinite
};

/// The fewest exposures that show every depth of all ranges sharp, from near to far. A range deeper than one
/// depth of field gets several. Throws std::invalid_argument if validate() refuses the optics, or a range is
/// empty or does not lie beyond the focal length.
std::vector<PlannedFocus> planFocus(const Optics& optics, std::vector<DepthRange> ranges);

}  // namespace all_in_focus::core
