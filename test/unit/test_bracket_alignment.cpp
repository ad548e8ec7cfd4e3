// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "alignment/alignment_parameters.hpp"
#include "alignment/bracket_alignment.hpp"
#include "bracket_drawing.hpp"

using namespace all_in_focus::core;
using bracket_drawing::addNoise;
using bracket_drawing::frame;
using bracket_drawing::kCenter;
using bracket_drawing::kSize;
using bracket_drawing::refocused;

namespace {

constexpr double kFocal = 50;  // mm
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kMostError =
    0.1;  // px; alignment leaves frames where they are that have moved by less than 0.3

// Equally spaced in dioptres, 0.6 m to infinity.
double focusDistance(int k, int n) {
  return 1000 / (1.6 - 1.6 * k / (n - 1));
}

double breathingScale(double b, int k, int reference, int n) {
  const auto v = [&](int i) { return 1 / (1 / kFocal - 1 / focusDistance(i, n)); };
  return 1 + b * (v(k) / v(reference) - 1);
}

// Pixels by which a placement is off anywhere in the picture.
double error(const Placement& placement, const SimilarityTransform& truth) {
  return largestDisplacement(compose(inverse(truth), placement), kSize, kCenter);
}

BracketAlignment begun() {
  BracketAlignment alignment;
  alignment.begin(kSize, kCenter);
  return alignment;
}

TEST(PairAlignment, FindsTheMotionUnderOppositeChangesOfBlur) {
  const ImagePyramid key(frame({}, 0.5, 4));
  PairAlignment alignment;
  alignment.setKey(key, kCenter);
  for (const SimilarityTransform& truth :
       {SimilarityTransform{}, SimilarityTransform{1.004, {0.2, -0.1}}, SimilarityTransform{0.99, {1.5, 2.5}},
        SimilarityTransform{1.03, {-4, 3}}, SimilarityTransform{1, {}, 0.01},
        SimilarityTransform{0.995, {2, -1}, -0.02}}) {
    const ImagePyramid other(frame(truth, 4, 0.5));
    const PairMeasurement found = alignment.measure(other, {});
    EXPECT_TRUE(found.converged);
    EXPECT_GT(found.correlation, 0.95);  // 0.97: the one is blurred more than the other
    EXPECT_LT(largestDisplacement(compose(inverse(truth), found.motion), kSize, kCenter), kMostError)
        << truth.scale;
  }
}

TEST(PairAlignment, HasNoBiasTowardsWholePixels) {
  const ImagePyramid key(frame({}));
  PairAlignment alignment;
  alignment.setKey(key, kCenter);
  for (double shift = 0; shift < 2; shift += 0.25) {
    const ImagePyramid other(frame({1, {shift, -shift}}));
    // 0.0025; a bias towards whole pixels would be largest in their middle
    EXPECT_LT(cv::norm(alignment.measure(other, {}).motion.shift - cv::Point2d(shift, -shift)), 0.005)
        << shift;
  }
}

TEST(PairAlignment, WhatCannotBeComputedIsNoMotion) {
  const ImagePyramid key(frame({})), other(frame({1, {2, 1}}));
  PairAlignment alignment;
  for (const double far : {1e161, 1e300, kInfinity}) {
    alignment.setKey(key, {far, far});
    EXPECT_FALSE(alignment.measure(other, {}).converged) << far;
  }
}

TEST(BracketAlignment, MotionsThatBlurringContoursMayFeignAreNone) {
  const cv::Size size(2400, 1800);
  BracketAlignment alignment;
  alignment.begin(size, {1200, 900});
  const std::vector<double> shifts = {0, 0.45, 1.5};  // px; in a picture 640 wide: 0.12 and 0.4
  for (int k = 0; k < 3; ++k) {
    cv::Mat gray(size, CV_8UC1, cv::Scalar(150));
    int light = 60;
    for (const cv::Point& at : {cv::Point(400, 400), {2000, 300}, {500, 1400}, {1800, 1300}}) {
      const cv::Point shifted = 64 * at + cv::Point(cvRound(64 * shifts[k]), 0);
      cv::circle(gray, shifted, 64 * 250, light += 15, cv::FILLED, cv::LINE_AA, 6);
    }
    cv::GaussianBlur(gray, gray, {}, 4);
    alignment.observe(gray, k);
  }
  EXPECT_TRUE(alignment.placement(1, 0).isIdentity());
  EXPECT_NEAR(alignment.placement(2, 0).shift.x, 1.5, 0.1);
}

TEST(BracketAlignment, StaticBracketsStayAsTheyAre) {
  for (const double noise : {0.0, 5.0, 10.0}) {
    BracketAlignment alignment = begun();
    for (int k = 0; k < 5; ++k) {
      cv::Mat gray = refocused({}, k, 5);
      addNoise(noise, k, gray);
      alignment.observe(gray, k);
    }
    for (int k = 0; k < 5; ++k) {
      const Placement placement = alignment.placement(k, 2);
      EXPECT_TRUE(placement.isIdentity()) << k << " noise " << noise;
      EXPECT_TRUE(placement.fits && placement.measured);
    }
  }
}

TEST(BracketAlignment, FindsTheBreathingOfTheLens) {
  constexpr int n = 6, reference = 3;
  for (const double b : {-0.6, 0.3, 1.0}) {
    BracketAlignment alignment = begun();
    for (int k = 0; k < n; ++k) {
      cv::Mat gray = refocused({breathingScale(b, k, reference, n), {}}, k, n);
      addNoise(2, k, gray);
      alignment.observe(gray, k);
    }
    for (int k = 0; k < n; ++k) {
      EXPECT_LT(error(alignment.placement(k, reference), {breathingScale(b, k, reference, n), {}}),
                kMostError)
          << b;
    }
  }
}

TEST(BracketAlignment, FollowsAMovingCamera) {
  constexpr int n = 6;
  std::vector<SimilarityTransform> truth(n);
  cv::RNG random(4);
  for (int k = 1; k < n; ++k) {
    truth[k].scale = breathingScale(1, k, 0, n);
    truth[k].shift = truth[k - 1].shift + cv::Point2d(random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0));
  }
  BracketAlignment alignment = begun();
  for (int k = 0; k < n; ++k) {
    alignment.observe(refocused(truth[k], k, n), k);
    EXPECT_LT(error(alignment.placement(k, 0), truth[k]), kMostError) << k;  // as far as known by then
  }
  EXPECT_LT(error(alignment.placement(1, 4), compose(inverse(truth[4]), truth[1])), kMostError);
}

TEST(BracketAlignment, FollowsASaggingHead) {
  constexpr int n = 6;
  BracketAlignment alignment = begun();
  std::vector<SimilarityTransform> truth(n);
  for (int k = 0; k < n; ++k) {
    truth[k] = {breathingScale(0.5, k, 0, n), {0.4 * k, 1.1 * k}, 0.002 * k};
    alignment.observe(refocused(truth[k], k, n), k);
  }
  for (int k = 0; k < n; ++k) {
    EXPECT_LT(error(alignment.placement(k, 3), compose(inverse(truth[3]), truth[k])), kMostError) << k;
  }
}

TEST(BracketAlignment, DoesNotDrift) {
  constexpr int n = 60;
  BracketAlignment alignment = begun();
  SimilarityTransform truth;
  for (int k = 0; k < n; ++k) {
    truth = {1 + 0.05 * k / n, {0.05 * k, 0}};
    cv::Mat gray = refocused(truth, k, n);
    addNoise(3, k, gray);
    alignment.observe(gray, k);
  }
  EXPECT_LT(error(alignment.placement(n - 1, 0), truth), kMostError);
}

TEST(BracketAlignment, UnnoticeableMotionsAreNone) {
  BracketAlignment alignment = begun();
  alignment.observe(frame({}), 0);
  alignment.observe(frame({1, {0.3, 0}}), 1);
  EXPECT_FALSE(alignment.moves(0));
  alignment.observe(frame({1, {0.4, 0}}), 2);
  EXPECT_TRUE(alignment.moves(0));
  EXPECT_TRUE(alignment.placement(1, 0).isIdentity());
  EXPECT_FALSE(alignment.placement(2, 0).isIdentity());
}

TEST(BracketAlignment, ForeignFramesDoNotFitAndDoNoHarm) {
  constexpr int n = 5;
  const cv::Mat foreign = frame({}, 1, 1, 77), black(kSize, CV_8UC1, cv::Scalar(2));
  for (const cv::Mat& bad : {foreign, black}) {
    for (const int at : {0, 2, 4}) {
      BracketAlignment alignment = begun();
      for (int k = 0; k < n; ++k) {
        if (k == at) alignment.observe(bad, 100);
        alignment.observe(refocused({breathingScale(1, k, 2, n), {}}, k, n), k);
      }
      EXPECT_FALSE(alignment.placement(100, 2).fits) << at;
      EXPECT_TRUE(alignment.placement(100, 2).isIdentity());
      for (int k = 0; k < n; ++k) {
        EXPECT_TRUE(alignment.placement(k, 2).fits) << k;
        EXPECT_LT(error(alignment.placement(k, 2), {breathingScale(1, k, 2, n), {}}), kMostError) << k;
      }
    }
  }
}

TEST(BracketAlignment, ReturnsToASceneAfterAnInterruption) {
  BracketAlignment alignment = begun();
  int index = 0;
  for (const int seed : {1, 1, 8, 8, 1, 1})
    alignment.observe(frame({1, {0.5 * index, 0}}, 0, 0, seed), index), ++index;
  EXPECT_FALSE(alignment.placement(3, 0).fits);
  EXPECT_TRUE(alignment.placement(3, 2).fits);
  EXPECT_TRUE(alignment.placement(5, 0).fits);
  EXPECT_NEAR(alignment.placement(5, 0).shift.x, 2.5, 0.05);
}

TEST(BracketAlignment, TheLastFrameBeforeAnInterruptionIsKept) {
  BracketAlignment alignment = begun();
  const std::vector<std::pair<double, int>> frames = {{0, 1}, {5, 1}, {0, 8}, {0, 8}, {18, 1}, {22, 1}};
  for (size_t k = 0; k < frames.size();
       ++k)  // the later ones are near enough to the second, not to the first
    alignment.observe(frame({1, {frames[k].first, 0}}, 0, 0, frames[k].second), static_cast<int>(k));
  for (const int k : {1, 4, 5}) EXPECT_TRUE(alignment.placement(k, 0).fits) << k;
  for (const int k : {2, 3}) EXPECT_FALSE(alignment.placement(k, 0).fits) << k;
}

TEST(BracketAlignment, FramesOutOfOrderFitTheNearestKeyFrame) {
  BracketAlignment alignment = begun();
  const std::vector<double> scales = {1, 1.03, 1.06, 1.09, 1.12, 1.15, 1, 1.1, 1.02, 1.15};
  for (int k = 0; k < static_cast<int>(scales.size()); ++k) {
    alignment.observe(frame({scales[k], {}}), k);
    const Placement placement = alignment.placement(k, 0);
    EXPECT_TRUE(placement.fits) << k;
    EXPECT_LT(error(placement, {scales[k], {}}), 0.3) << k;
  }
}

TEST(BracketAlignment, ARejectedFrameIsTriedAgainstLaterOnes) {
  BracketAlignment alignment = begun();
  const std::vector<double> shifts = {0, 32, 8, 16, 24};  // 16 is the most that can be measured
  for (int k = 0; k < static_cast<int>(shifts.size()); ++k) alignment.observe(frame({1, {shifts[k], 0}}), k);
  ASSERT_FALSE(alignment.placement(1, 0).fits);
  EXPECT_FALSE(alignment.placement(1, 0).fits);
  alignment.reconsider(frame({1, {32, 0}}), 1, 0);
  EXPECT_TRUE(alignment.placement(1, 0).fits);
  EXPECT_LT(error(alignment.placement(1, 0), {1, {32, 0}}), 0.3);
  // Nothing comes nearer to another scene.
  alignment.observe(frame({}, 0, 0, 77), 9);
  alignment.reconsider(frame({}, 0, 0, 77), 9, 0);
  EXPECT_FALSE(alignment.placement(9, 0).fits);
}

TEST(BracketAlignment, TellsTwoScenesApart) {
  BracketAlignment alignment = begun();
  int index = 0;
  for (const int seed : {1, 1, 8, 8, 8}) alignment.observe(frame({}, 0, 0, seed), index++);
  for (const int k : {0, 1}) {
    EXPECT_FALSE(alignment.placement(k, 3).fits);
    EXPECT_FALSE(alignment.placement(3, k).fits);
  }
  EXPECT_TRUE(alignment.placement(3, 2).fits);
}

TEST(BracketAlignment, DefocusAndExposureAreNotRejected) {
  BracketAlignment alignment = begun();
  alignment.observe(frame({}), 0);
  alignment.observe(frame({}, 12, 12), 1);
  alignment.observe(frame({}, 0, 6) * 0.7, 2);
  alignment.observe(frame({1.01, {}}, 6, 0) * 1.2, 3);
  for (const int k : {1, 2, 3}) EXPECT_TRUE(alignment.placement(k, 0).fits);
  EXPECT_TRUE(alignment.placement(2, 0).isIdentity());
  EXPECT_LT(error(alignment.placement(3, 0), {1.01, {}}), kMostError);
}

TEST(BracketAlignment, TooFarIsRejected) {
  BracketAlignment alignment = begun();
  alignment.observe(frame({}), 0);
  alignment.observe(frame({1, {0.2 * kSize.width, 0}}), 1);
  EXPECT_FALSE(alignment.placement(1, 0).fits);
}

TEST(BracketAlignment, NothingToSeeIsNoMotion) {
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(5, 40), cv::Size(64, 48)}) {
    BracketAlignment alignment;
    alignment.begin(size, {size.width / 2.0, size.height / 2.0});
    for (int k = 0; k < 3; ++k) {
      alignment.observe(cv::Mat(size, CV_8UC1, cv::Scalar(90 + k)), k);
      EXPECT_TRUE(alignment.placement(k, 0).isIdentity());
      EXPECT_TRUE(alignment.placement(k, 0).fits);
    }
  }
}

TEST(BracketAlignment, BeginsAnew) {
  BracketAlignment alignment = begun();
  alignment.observe(frame({}), 0);
  alignment.begin(kSize, kCenter);
  alignment.observe(frame({}, 0, 0, 5), 0);
  alignment.observe(frame({1, {2, 0}}, 0, 0, 5), 1);
  EXPECT_NEAR(alignment.placement(1, 0).shift.x, 2, 0.02);
}

}  // namespace
