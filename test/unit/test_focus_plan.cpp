// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include "all_in_focus/dof_segmentation.hpp"
#include "all_in_focus/focus_plan.hpp"

using namespace all_in_focus::core;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTolerance = 1e-7;

// Every depth of the ranges lies within the limits of an exposure. Looked for from the near end of each
// range, in the order of the plan.
bool covers(const std::vector<PlannedFocus>& plan, const std::vector<DepthRange>& ranges) {
  for (const DepthRange& range : ranges) {
    double sharp_to = 1 / range.min_mm;
    const double wanted = 1 / range.max_mm;
    for (const PlannedFocus& one : plan) {
      if (1 / one.near_mm >= sharp_to - kTolerance * sharp_to) sharp_to = std::min(sharp_to, 1 / one.far_mm);
    }
    if (sharp_to > wanted + kTolerance / range.min_mm) return false;
  }
  return true;
}

// The limits are those of the equations.
void expectLimits(const Optics& optics, const PlannedFocus& one) {
  if (std::isinf(one.focus_mm)) {
    EXPECT_NEAR(one.near_mm, hyperfocalDistance(optics), 1e-6 * one.near_mm);
    EXPECT_EQ(one.far_mm, kInfinity);
    return;
  }
  EXPECT_NEAR(one.near_mm, one.focus_mm - frontDof(optics, one.focus_mm), 1e-6 * one.near_mm);
  const double back = one.focus_mm + backDof(optics, one.focus_mm);
  if (std::isinf(back)) {
    EXPECT_EQ(one.far_mm, kInfinity);
  } else {
    EXPECT_NEAR(one.far_mm, back, 1e-6 * back);
  }
}

// In units where an exposure covers `span` whole steps of a line: ranges from..to, and whether `count`
// exposures at whole steps cover them all.
struct Steps {
  int from, to;
};

bool canCover(const std::vector<Steps>& ranges, int span, int count, int begin, int end,
              std::vector<bool>& sharp) {
  // Half a step counts: ranges are continuous. Cell c is the stretch from step c to c + 1.
  const auto complete = [&] {
    for (const Steps& range : ranges) {
      for (int cell = range.from; cell < range.to; ++cell) {
        if (!sharp[cell]) return false;
      }
    }
    return true;
  };
  if (complete()) return true;
  if (count == 0) return false;
  for (int at = begin; at < end; ++at) {
    const std::vector<bool> before = sharp;
    for (int cell = at; cell < std::min(at + span, static_cast<int>(sharp.size())); ++cell)
      sharp[cell] = true;
    if (canCover(ranges, span, count - 1, at + 1, end, sharp)) return true;
    sharp = before;
  }
  return false;
}

// The thinnest depth of field that a lens can have: the plan would have 1e9 exposures.
TEST(FocusPlan, AnExtremeLensHasNoPlan) {
  const Optics optics{kFocalLengthRange.max, kApertureRange.min, kCircleOfConfusionRange.min};
  EXPECT_THROW(planFocus(optics, std::vector<DepthRange>{{11000, 60000}}), std::invalid_argument);
  EXPECT_THROW(planFocus({24, 1e-200, 1e-200}, std::vector<DepthRange>{{500, 3000}}), std::invalid_argument);
}

TEST(FocusPlan, IsOptimal) {
  // Spans of whole steps and ranges between whole steps: an optimal cover at whole steps is one of all
  // covers, because any exposure can be moved towards the far end until it begins at the near end of
  // something.
  const Optics optics;
  const int span = 3, cells = 14;
  const double step = 2 / hyperfocalDistance(optics) / span, nearest = 1 / 400.0;
  std::mt19937 random(1);
  for (int round = 0; round < 400; ++round) {
    std::vector<Steps> steps;
    std::vector<DepthRange> ranges;
    const int count = 1 + static_cast<int>(random() % 5);
    for (int i = 0; i < count; ++i) {
      const int from = static_cast<int>(random() % (cells - 1));
      const int to = std::min(cells, from + 1 + static_cast<int>(random() % 5));
      steps.push_back({from, to});
      ranges.push_back({1 / (nearest - from * step), 1 / (nearest - to * step)});
    }
    const std::vector<PlannedFocus> plan = planFocus(optics, ranges);
    ASSERT_TRUE(covers(plan, ranges)) << round;
    for (const PlannedFocus& one : plan) expectLimits(optics, one);
    std::vector<bool> sharp(cells, false);
    const int planned = static_cast<int>(plan.size());
    ASSERT_TRUE(canCover(steps, span, planned, 0, cells, sharp)) << round;
    std::fill(sharp.begin(), sharp.end(), false);
    ASSERT_FALSE(canCover(steps, span, planned - 1, 0, cells, sharp)) << round;
  }
}

TEST(FocusPlan, NearToFarAndNotBeyondNeed) {
  std::mt19937 random(2);
  for (const Optics& optics : {Optics{24, 4, 0.019}, Optics{50, 1.8, 0.03}, Optics{8, 16, 0.05}}) {
    for (int round = 0; round < 100; ++round) {
      std::vector<DepthRange> ranges;
      double nearest = kInfinity, farthest = 0;
      for (int i = 0; i < 6; ++i) {
        const auto min = static_cast<double>(300 + random() % 8000),
                   max = min + static_cast<double>(random() % 3000);
        ranges.push_back({min, max});
        nearest = std::min(nearest, min);
        farthest = std::max(farthest, max);
      }
      const std::vector<PlannedFocus> plan = planFocus(optics, ranges);
      ASSERT_TRUE(covers(plan, ranges));
      for (std::size_t i = 0; i < plan.size(); ++i) {
        expectLimits(optics, plan[i]);
        EXPECT_GE(plan[i].focus_mm, nearest * (1 - kTolerance));
        EXPECT_LE(plan[i].focus_mm, farthest * (1 + kTolerance));
        if (i > 0) {
          EXPECT_GT(plan[i].focus_mm, plan[i - 1].focus_mm);
        }
      }
    }
  }
}

TEST(FocusPlan, OneRegionOfTheFullRuleIsOneExposureOnItsMiddle) {
  const Optics optics;
  const DofRule rule(optics, DofSpan::kFull);
  for (int min = 300; min < 60000; min += 1 + min / 30) {
    int max = min;
    while (max < 65535 && rule.fits(min, max + 1)) ++max;  // as deep as can be
    const auto plan = planFocus(optics, {DepthRange{static_cast<double>(min), static_cast<double>(max)}});
    ASSERT_EQ(plan.size(), 1u) << min << ' ' << max;
    EXPECT_NEAR(plan[0].focus_mm, dioptricMiddle(min, max), 1e-9 * max);
  }
}

TEST(FocusPlan, DeepRegionIsCoveredBySeveral) {
  const Optics optics;
  const double h = hyperfocalDistance(optics);
  const DepthRange range{500, 1 / (1 / 500.0 - 5.5 * 2 / h)};  // 5.5 depths of field
  const auto plan = planFocus(optics, {range});
  ASSERT_EQ(plan.size(), 6u);
  EXPECT_TRUE(covers(plan, {range}));
  EXPECT_NEAR(plan[0].near_mm, 500, 1e-5);
  for (std::size_t i = 1; i + 1 < plan.size(); ++i) EXPECT_NEAR(plan[i].near_mm, plan[i - 1].far_mm, 1e-4);
}

TEST(FocusPlan, RangesInsideOneSpanShareAnExposure) {
  const Optics optics;  // H = 7.58 m: from 1 m one exposure reaches 1.36 m
  const auto plan = planFocus(optics, {DepthRange{1300, 1350}, {1000, 1010}, {1100, 1340}, {3000, 3000}});
  ASSERT_EQ(plan.size(), 2u);
  EXPECT_NEAR(plan[0].focus_mm, dioptricMiddle(1000, 1350), 1e-6);
  EXPECT_NEAR(plan[1].focus_mm, 3000, 1e-6);
}

TEST(FocusPlan, HyperfocalDistanceAndInfinity) {
  const Optics optics;
  const double h = hyperfocalDistance(optics);
  auto plan = planFocus(optics, {DepthRange{h / 2, kInfinity}});  // what the hyperfocal distance makes sharp
  ASSERT_EQ(plan.size(), 1u);
  EXPECT_NEAR(plan[0].focus_mm, h, 1e-6 * h);
  EXPECT_NEAR(plan[0].near_mm, h / 2, 1e-6 * h);
  EXPECT_EQ(plan[0].far_mm, kInfinity);

  plan = planFocus(optics, {DepthRange{0.49 * h, kInfinity}});
  ASSERT_EQ(plan.size(), 2u);
  EXPECT_LT(plan[0].focus_mm, h);
  EXPECT_EQ(plan[1].far_mm, kInfinity);

  plan = planFocus(optics, {DepthRange{kInfinity, kInfinity}});
  ASSERT_EQ(plan.size(), 1u);
  EXPECT_EQ(plan[0].focus_mm, kInfinity);
  EXPECT_NEAR(plan[0].near_mm, h, 1e-6 * h);
}

TEST(FocusPlan, NothingToPlan) {
  EXPECT_TRUE(planFocus({}, std::vector<Segment>{}).empty());
}

TEST(FocusPlan, SegmentsAreTheirDepthRanges) {
  Segment near, far;
  near.min_mm = 1000, near.max_mm = 1010, far.min_mm = 3000, far.max_mm = 3010;
  const auto plan = planFocus({}, {near, far});
  ASSERT_EQ(plan.size(), 2u);
  EXPECT_NEAR(plan[1].focus_mm, dioptricMiddle(3000, 3010), 1e-6);
}

TEST(FocusPlan, ImpossibleInputIsRefused) {
  for (const DepthRange& bad : {DepthRange{0, 100}, {-5, 100}, {100, 99}, {24, 1000}, {std::nan(""), 100}}) {
    EXPECT_THROW(planFocus({}, {bad}), std::invalid_argument) << bad.min_mm;
  }
  EXPECT_THROW(planFocus({0, 4, 0.019}, std::vector<DepthRange>{}), std::invalid_argument);
}

}  // namespace
