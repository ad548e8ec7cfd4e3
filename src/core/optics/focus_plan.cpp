// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/focus_plan.hpp"

#include <algorithm>
#include <limits>
#include <opencv2/core.hpp>
#include <stdexcept>

namespace all_in_focus::core {
namespace {

// Relative tolerance of a span. Without it the rounding of 1 / depth could split a region that fits one depth
// of field.
constexpr double kRounding = 1e-9;
// Nobody takes so many; with an extreme lens the loop below would go on for hours.
constexpr std::size_t kMaxExposures = 10000;

void requireBeyondFocalLength(const Optics& optics, const DepthRange& range) {
  if (range.min_mm > optics.focal_length_mm && range.min_mm <= range.max_mm) return;
  throw std::invalid_argument(cv::format(
      "focus plan: depths %g to %g mm are not a range beyond the focal length", range.min_mm, range.max_mm));
}

// Sharp around a focus distance is a dioptre span of 2/H: by equations 9 and 10
//   1 / near = 1 / focus + 1/H,   1 / far = 1 / focus - 1/H (infinite from the hyperfocal distance on).
PlannedFocus exposure(double focus_dioptre, double hyperfocal_mm) {
  const double infinity = std::numeric_limits<double>::infinity();
  const double far = focus_dioptre - 1 / hyperfocal_mm;
  return {focus_dioptre > 0 ? 1 / focus_dioptre : infinity, 1 / (focus_dioptre + 1 / hyperfocal_mm),
          far > 0 ? 1 / far : infinity};
}

}  // namespace

// In dioptres (1 / mm) the ranges are intervals of a line and each exposure covers an interval of length 2/H,
// wherever it is focused. The greedy cover puts the near end of each exposure on the nearest depth that is
// not sharp yet. No cover has fewer exposures: order both from near to far. The first exposure of any cover
// holds the nearest depth, so it ends no farther than the greedy one's; and if its k-th ends no farther than
// the greedy k-th, what the greedy cover has left over is left over there too, so its next exposure ends no
// farther either. Hence while the greedy cover is incomplete, no other of as many exposures is complete.
std::vector<PlannedFocus> planFocus(const Optics& optics, std::vector<DepthRange> ranges) {
  validate(optics);
  for (const DepthRange& range : ranges) requireBeyondFocalLength(optics, range);
  std::sort(ranges.begin(), ranges.end(),
            [](const DepthRange& a, const DepthRange& b) { return a.min_mm < b.min_mm; });
  const double hyperfocal = hyperfocalDistance(optics);
  const double span = 2 / hyperfocal * (1 + kRounding);

  std::vector<PlannedFocus> plan;
  double sharp_to =
      std::numeric_limits<double>::infinity();  // dioptres: all depths nearer than that are sharp
  for (std::size_t i = 0;;) {
    while (i < ranges.size() && 1 / ranges[i].max_mm >= sharp_to) ++i;
    if (i == ranges.size()) return plan;
    if (plan.size() == kMaxExposures) {
      throw std::invalid_argument(cv::format(
          "focus plan: more than %zu exposures: check the optics, their depth of field is too thin",
          kMaxExposures));
    }
    const double near = std::min(1 / ranges[i].min_mm, sharp_to);
    // Of the span that begins there only what holds depths is needed. The lens is focused on the middle of
    // that: nothing is blurred more than it must be, and no focus lies beyond the depths.
    double far = near;
    for (std::size_t j = i; j < ranges.size() && 1 / ranges[j].min_mm >= near - span; ++j) {
      far = std::min(far, std::max(1 / ranges[j].max_mm, near - span));
    }
    plan.push_back(exposure((near + far) / 2, hyperfocal));
    sharp_to = far;
  }
}

}  // namespace all_in_focus::core
