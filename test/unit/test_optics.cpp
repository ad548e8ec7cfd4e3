// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "all_in_focus/optics.hpp"

using namespace all_in_focus::core;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Golden {  // tables 1 and 2 of the paper
  int min, max, diff, max_dof;
  bool fits;
};

const Golden kGolden[] = {{2722, 3115, 393, 1526, true}, {2417, 2639, 222, 1132, true},
                          {832, 1360, 528, 207, false},  {2463, 3140, 677, 1186, true},
                          {855, 962, 107, 109, true},    {950, 1085, 135, 136, true},
                          {1088, 1269, 181, 182, true},  {1273, 1412, 139, 257, true}};

TEST(Optics, ReproducesThePapersTables) {
  const Optics optics;
  for (const Golden& g : kGolden) {
    EXPECT_EQ(g.max - g.min, g.diff);
    EXPECT_EQ(std::lround(maxDof(optics, g.min, g.max)), g.max_dof) << g.min;
    EXPECT_EQ(DofRule(optics).fits(g.min, g.max), g.fits) << g.min;
  }
}

TEST(Optics, HyperfocalDistanceOfThePapersLens) {
  EXPECT_NEAR(hyperfocalDistance({24, 4, 0.019}), 7578.9, 0.1);
}

TEST(Optics, DepthOfFieldIsInfiniteFromTheHyperfocalDistanceOn) {
  const Optics optics;
  const double h = hyperfocalDistance(optics);
  EXPECT_TRUE(std::isfinite(backDof(optics, 0.999 * h)));
  EXPECT_EQ(backDof(optics, 1.001 * h), kInfinity);
  EXPECT_EQ(maxDof(optics, 1.001 * h, 60000), kInfinity);
  EXPECT_TRUE(DofRule(optics).fits(7579, 65535));
}

TEST(Optics, DofRuleIsTheOneOfThePaperForAllDepths) {
  for (const Optics& optics : {Optics{24, 4, 0.019}, Optics{50, 1.8, 0.03}, Optics{8, 16, 0.05}}) {
    const DofRule rule(optics);
    for (int min = 300; min < 65535; min += 1 + min / 40) {
      for (int max = min; max < 65535; max += 1 + (max - min) / 8) {
        const double limit = maxDof(optics, min, max);
        if (std::abs(max - min - limit) < 1e-6 * limit) continue;  // on the edge rounding decides
        ASSERT_EQ(rule.fits(min, max), max - min < limit) << min << ' ' << max;
      }
    }
  }
}

TEST(Optics, FullRuleSpansTwiceTheDioptres) {
  const Optics optics;
  const double h = hyperfocalDistance(optics);
  const int min = 1010;
  const int paper = static_cast<int>(1 / (1.0 / min - 1 / h)),
            full = static_cast<int>(1 / (1.0 / min - 2 / h));
  EXPECT_TRUE(DofRule(optics, DofSpan::kPaper).fits(min, paper));
  EXPECT_FALSE(DofRule(optics, DofSpan::kPaper).fits(min, paper + 1));
  EXPECT_TRUE(DofRule(optics, DofSpan::kFull).fits(min, full));
  EXPECT_FALSE(DofRule(optics, DofSpan::kFull).fits(min, full + 1));
}

TEST(Optics, BlurCircleOfTheThinLens) {
  const Optics optics{50, 2, 0.02};  // lens 25 mm across
  EXPECT_EQ(blurCircle(optics, 1000, 1000), 0);
  // f^2 / F |u - s| / (u (s - f)) = 1250 * 1000 / (2000 * 950)
  EXPECT_NEAR(blurCircle(optics, 2000, 1000), 1250.0 * 1000 / (2000.0 * 950), 1e-12);
  EXPECT_NEAR(blurCircle(optics, kInfinity, 1000), 1250.0 / 950, 1e-12);
  EXPECT_NEAR(blurCircle(optics, 2000, kInfinity), 1250.0 / 2000, 1e-12);
  EXPECT_EQ(imageDistance(optics, kInfinity), 50);
  EXPECT_NEAR(imageDistance(optics, 1000), 50.0 * 1000 / 950, 1e-12);
}

TEST(Optics, DioptricMiddleBlursBothEndsEqually) {
  const Optics optics;
  const double middle = dioptricMiddle(900, 1300);
  EXPECT_NEAR(blurCircle(optics, 900, middle), blurCircle(optics, 1300, middle), 1e-12);
}

TEST(Optics, ImpossibleValuesAreNamed) {
  for (const double bad : {0.0, -1.0, kInfinity, std::nan(""), 1e-200, 1e200}) {
    EXPECT_THROW(validate({bad, 4, 0.019}), std::invalid_argument);
    EXPECT_THROW(validate({24, bad, 0.019}), std::invalid_argument);
    EXPECT_THROW(validate({24, 4, bad}), std::invalid_argument);
  }
  try {
    validate({24, -2, 0.019});
    FAIL();
  } catch (const std::invalid_argument& e) {
    EXPECT_NE(std::string(e.what()).find("aperture"), std::string::npos);
  }
}

}  // namespace
