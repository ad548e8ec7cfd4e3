// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "all_in_focus/hole_filling.hpp"

using namespace all_in_focus::core;

namespace {

double flow(double d) {
  return std::exp(-(d / 25) * (d / 25)) * d;
}

TEST(Dilation, TakesTheLargestOfNine) {
  cv::Mat depth = cv::Mat::zeros(5, 5, CV_16UC1), dilated;
  depth.at<std::uint16_t>(2, 2) = 1000;
  depth.at<std::uint16_t>(0, 0) = 3000;
  dilateDepth(depth, dilated);
  EXPECT_EQ(dilated.at<std::uint16_t>(1, 1), 3000);
  EXPECT_EQ(dilated.at<std::uint16_t>(3, 3), 1000);
  EXPECT_EQ(dilated.at<std::uint16_t>(4, 4), 0);
}

TEST(DiffusionFilling, FollowsEquation7) {
  cv::Mat depth = (cv::Mat_<std::uint16_t>(4, 3) << 0, 1010, 0, 980, 1000, 1030, 0, 990, 0, 5, 0, 0);
  fillByDiffusion(depth);
  const double expected = 1000 + 0.25 * (flow(10) + flow(-10) + flow(-20) + flow(30));
  EXPECT_EQ(depth.at<std::uint16_t>(3, 1), std::lround(expected));
}

TEST(DiffusionFilling, NoGradientBeyondTheSides) {
  cv::Mat depth = (cv::Mat_<std::uint16_t>(4, 2) << 1000, 1000, 1000, 1000, 1000, 1000, 0, 0);
  fillByDiffusion(depth);
  EXPECT_EQ(depth.at<std::uint16_t>(3, 0), 1000);
  EXPECT_EQ(depth.at<std::uint16_t>(3, 1), 1000);
}

TEST(DiffusionFilling, FirstThreeRowsStay) {
  cv::Mat depth = cv::Mat::zeros(6, 4, CV_16UC1);
  depth.row(0) = 1200;
  fillByDiffusion(depth);
  EXPECT_EQ(cv::countNonZero(depth.rowRange(1, 3)), 0);
}

TEST(DiffusionFilling, FilledValuesServeTheRowsBelow) {
  cv::Mat depth = cv::Mat::zeros(20, 4, CV_16UC1);
  depth.rowRange(0, 3) = 1500;
  fillByDiffusion(depth);
  EXPECT_EQ(cv::countNonZero(depth == 1500), 80);
}

TEST(DiffusionFilling, HoleUnderAHoleStaysAndMeasuredDepthIsUntouched) {
  cv::Mat depth = cv::Mat::zeros(6, 3, CV_16UC1);
  depth.at<std::uint16_t>(5, 1) = 777;
  fillByDiffusion(depth);
  EXPECT_EQ(cv::countNonZero(depth), 1);
  EXPECT_EQ(depth.at<std::uint16_t>(5, 1), 777);
}

TEST(DiffusionFilling, AnySizeIsSafe) {
  for (int rows = 1; rows < 6; ++rows) {
    for (int cols = 1; cols < 4; ++cols) {
      cv::Mat depth = cv::Mat::zeros(rows, cols, CV_16UC1);
      EXPECT_NO_THROW(fillByDiffusion(depth));
    }
  }
}

cv::Mat filledFromFarSide(const cv::Mat& depth) {
  cv::Mat filled;
  fillFromFarSide(depth, filled);
  return filled;
}

TEST(FarSideFilling, TakesTheFartherEndOfTheRow) {
  const cv::Mat depth =
      (cv::Mat_<std::uint16_t>(1, 12) << 900, 0, 0, 2500, 2500, 2500, 2500, 0, 900, 900, 900, 900);
  const cv::Mat filled = filledFromFarSide(depth);
  for (const int u : {1, 2, 7}) EXPECT_EQ(filled.at<std::uint16_t>(0, u), 2500);
  EXPECT_EQ(cv::countNonZero(filled == 900), 5);
}

TEST(FarSideFilling, GoesAcrossTheNarrowSide) {
  // A shadow of two rows above a near panel, before a far wall that flanks both.
  cv::Mat depth(8, 12, CV_16UC1, cv::Scalar(4000));
  depth(cv::Rect(1, 0, 10, 3)) = 2000;
  depth(cv::Rect(1, 3, 10, 2)) = 0;
  depth(cv::Rect(1, 5, 10, 3)) = 900;
  EXPECT_EQ(cv::countNonZero(filledFromFarSide(depth)(cv::Rect(1, 3, 10, 2)) == 2000), 20);
  EXPECT_EQ(cv::countNonZero(filledFromFarSide(depth.t())(cv::Rect(3, 1, 2, 10)) == 2000), 20);
}

TEST(FarSideFilling, LeavesWhatTheSensorCouldNotSee) {
  const cv::Mat depth = (cv::Mat_<std::uint16_t>(3, 5) << 0, 0, 1000, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
  EXPECT_EQ(cv::countNonZero(filledFromFarSide(depth)), 1);
}

TEST(FarSideFilling, AHoleAtTheSideIsFilledFromAboveAndBelow) {
  cv::Mat depth(5, 4, CV_16UC1, cv::Scalar(1500));
  depth(cv::Rect(0, 1, 2, 2)) = 0;
  EXPECT_EQ(cv::countNonZero(filledFromFarSide(depth) == 1500), 20);
}

TEST(HoleFilling, RefusesOtherTypes) {
  cv::Mat depth(4, 4, CV_32FC1), out, none;
  EXPECT_THROW(dilateDepth(depth, out), std::invalid_argument);
  EXPECT_THROW(fillByDiffusion(depth), std::invalid_argument);
  EXPECT_THROW(fillFromFarSide(none, out), std::invalid_argument);
}

}  // namespace
