// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <limits>

#include "fusion/region_summary.hpp"

using namespace all_in_focus::core;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
const cv::Size kSize(100, 50);

cv::Mat image(int type, double value) {
  return cv::Mat(kSize, type, cv::Scalar(value));
}

cv::Mat columns(cv::Mat image, int begin, int end, double value) {
  image.colRange(begin, end) = value;
  return image;
}

TEST(SummarizeRegions, NamesTheFrameThatWonMostPixels) {
  // Region 3 on the left half: frames 7 (60 %), 2 (30 %), 9 (10 %). Region 8 on the right: frame 2 alone.
  const cv::Mat labels = columns(image(CV_32SC1, 8), 0, 50, 3);
  cv::Mat source = image(CV_16UC1, 2), confidence = image(CV_8UC1, 51);
  columns(source, 0, 30, 7);
  columns(source, 45, 50, 9);
  columns(confidence, 25, 50, 255);
  const auto regions = summarizeRegions(labels, source, confidence);
  ASSERT_EQ(regions.size(), 2u);
  EXPECT_EQ(regions[0].label, 3);
  EXPECT_EQ(regions[0].frame, 7);
  EXPECT_DOUBLE_EQ(regions[0].score, 0.6);
  EXPECT_DOUBLE_EQ(regions[0].margin, 0.5);
  EXPECT_DOUBLE_EQ(regions[0].confidence, (0.2 + 1) / 2);
  EXPECT_EQ(regions[1].label, 8);
  EXPECT_EQ(regions[1].frame, 2);
  EXPECT_DOUBLE_EQ(regions[1].score, 1);
  EXPECT_DOUBLE_EQ(regions[1].margin, 1);
  EXPECT_DOUBLE_EQ(regions[1].confidence, 0.2);
}

TEST(SummarizeRegions, TheFirstFrameWinsADraw) {
  const cv::Mat source = columns(image(CV_16UC1, 1), 0, 50, 6);
  const auto regions = summarizeRegions(image(CV_32SC1, 1), source, image(CV_8UC1, 255));
  ASSERT_EQ(regions.size(), 1u);
  EXPECT_EQ(regions[0].frame, 1);
  EXPECT_EQ(regions[0].margin, 0);
}

TEST(SummarizeRegions, PixelsOfOneRegionNeedNotTouch) {
  cv::Mat labels = image(CV_32SC1, 0);
  for (int x = 0; x < kSize.width; x += 2) labels.col(x) = 2000000000;
  const auto regions = summarizeRegions(labels, image(CV_16UC1, 4), image(CV_8UC1, 0));
  ASSERT_EQ(regions.size(), 2u);
  EXPECT_EQ(regions[0].label, 0);
  EXPECT_EQ(regions[1].label, 2000000000);
  EXPECT_EQ(regions[1].frame, 4);
  EXPECT_EQ(regions[1].score, 1);
}

TEST(SummarizeRegions, PixelsOfNoFrameAreTold) {
  const auto regions = summarizeRegions(image(CV_32SC1, 1), image(CV_16UC1, kNoFrame), image(CV_8UC1, 0));
  ASSERT_EQ(regions.size(), 1u);
  EXPECT_EQ(regions[0].frame, kNoFrame);
}

BracketScene scene(const cv::Mat& labels, const cv::Mat& depth) {
  return {labels, depth, {}, {50, 2, 0.03}, {}};
}

// Region 1 at 1 m, region 2 at 4 m.
BracketScene nearAndFar() {
  return scene(columns(image(CV_32SC1, 2), 0, 50, 1), columns(image(CV_16UC1, 4000), 0, 50, 1000));
}

TEST(UnreachedDistances, NoneWhereAllIsSharp) {
  EXPECT_TRUE(unreachedDistances(nearAndFar(), {1000, 4000}).empty());
  EXPECT_TRUE(unreachedDistances(nearAndFar(), {980, 1500, 4200}).empty());
}

TEST(UnreachedDistances, NameDistanceRegionAndTheNearestFocus) {
  const auto lines = unreachedDistances(nearAndFar(), {990, 2000, 1500});
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(
      lines[0],
      "the bracket does not reach 4.00 m (region 2): focused at 2.00 m at best, its blur circle there is "
      "10.7 circles of confusion wide");
}

TEST(UnreachedDistances, TwiceTheCircleOfConfusionIsTheLimit) {
  // Blur circle of 4 m focused at s: 25 v |1/4000 - 1/s| with v close to 50 mm.
  const BracketScene wall = scene(image(CV_32SC1, 1), image(CV_16UC1, 4000));
  for (const double focus : {3400.0, 3300.0, 5000.0, kInfinity}) {
    const bool sharp = blurCircle(wall.optics, 4000, focus) <= 0.06;
    EXPECT_EQ(unreachedDistances(wall, {focus}).empty(), sharp) << focus;
  }
}

TEST(UnreachedDistances, FocusMayBeInfinite) {
  const BracketScene far = scene(image(CV_32SC1, 1), image(CV_16UC1, 60000));
  EXPECT_TRUE(unreachedDistances(far, {kInfinity}).empty());
  const auto lines = unreachedDistances(nearAndFar(), {kInfinity});
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_NE(lines[0].find("focused at inf"), std::string::npos) << lines[0];
}

TEST(UnreachedDistances, NothingIsSaidOfWhatIsUnknown) {
  const BracketScene known = nearAndFar();
  const std::vector<double> focus = {500};
  EXPECT_EQ(unreachedDistances(known, focus).size(), 2u);
  EXPECT_TRUE(unreachedDistances(known, {}).empty());
  EXPECT_TRUE(unreachedDistances(known, {500, std::numeric_limits<double>::quiet_NaN()}).empty());
  EXPECT_TRUE(unreachedDistances(scene({}, known.depth), focus).empty());
  EXPECT_TRUE(unreachedDistances(scene(known.labels, {}), focus).empty());
  EXPECT_TRUE(unreachedDistances(scene(known.labels, image(CV_16UC1, 0)), focus).empty());
}

TEST(UnreachedDistances, SmallRegionsAreNotWorthALine) {
  BracketScene scene = nearAndFar();
  scene.depth(cv::Rect(0, 0, 2, 2)) = 300;  // 4 of 5000 pixels
  scene.labels(cv::Rect(0, 0, 2, 2)) = 7;
  EXPECT_TRUE(unreachedDistances(scene, {1000, 4000}).empty());
  scene.depth(cv::Rect(0, 0, 3, 2)) = 300;
  scene.labels(cv::Rect(0, 0, 3, 2)) = 7;
  EXPECT_EQ(unreachedDistances(scene, {1000, 4000}).size(), 1u);
}

TEST(UnreachedDistances, ManyRegionsAreSummedUp) {
  cv::Mat labels = image(CV_32SC1, 0), depth = image(CV_16UC1, 0);
  for (int region = 1; region <= 10; ++region) {
    columns(labels, 10 * region - 10, 10 * region, region);
    columns(depth, 10 * region - 10, 10 * region, 500 + 50 * region);
  }
  const auto lines = unreachedDistances(scene(labels, depth), {10000});
  ASSERT_EQ(lines.size(), 6u);
  EXPECT_NE(lines[4].find("(region 5)"), std::string::npos);
  EXPECT_EQ(lines[5], "further regions are not reached either");
}

}  // namespace
