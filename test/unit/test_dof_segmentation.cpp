// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>

#include "all_in_focus/dof_segmentation.hpp"
#include "reference_segmentation.hpp"

using namespace all_in_focus::core;

namespace {

cv::Mat made(int rows, int cols, const std::function<int(int, int)>& value) {
  cv::Mat depth(rows, cols, CV_16UC1);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < cols; ++x)
      depth.at<std::uint16_t>(y, x) = cv::saturate_cast<std::uint16_t>(value(y, x));
  }
  return depth;
}

Segmentation segment(const cv::Mat& depth, const SegmentationConfig& config = {}) {
  Segmentation result;
  DofSegmentation(config).compute(depth, result);
  return result;
}

void expectAsDefined(const cv::Mat& depth, const char* what) {
  for (const bool against_rule : {false, true}) {
    for (const DofSpan span : {DofSpan::kPaper, DofSpan::kFull}) {
      const SegmentationConfig config{{24, 4, 0.019}, span, 10, against_rule};
      const Segmentation expected = referenceSegmentation(depth, config), result = segment(depth, config);
      ASSERT_EQ(result.segments.size(), expected.segments.size()) << what << against_rule;
      EXPECT_EQ(cv::countNonZero(result.labels != expected.labels), 0) << what << against_rule;
      EXPECT_EQ(result.unknown_area, expected.unknown_area) << what;
      for (std::size_t i = 0; i < expected.segments.size(); ++i) {
        const Segment &a = result.segments[i], &b = expected.segments[i];
        EXPECT_EQ(std::tie(a.label, a.area, a.min_mm, a.max_mm, a.median_mm, a.fits),
                  std::tie(b.label, b.area, b.min_mm, b.max_mm, b.median_mm, b.fits))
            << what << ", label " << b.label;
      }
    }
  }
}

TEST(DofSegmentation, LabelsAreThoseOfTheDefinition) {
  cv::RNG random(7);
  expectAsDefined(made(30, 40, [](int, int) { return 1500; }), "all equal");
  expectAsDefined(made(30, 40, [](int y, int x) { return 500 + 40 * y + x; }), "all different");
  expectAsDefined(made(30, 40, [](int y, int x) { return (x + y) % 2 ? 900 : 3000; }), "checkerboard");
  expectAsDefined(made(30, 40, [](int y, int x) { return (x + y) % 2 ? 900 : 905; }), "shallow checkerboard");
  expectAsDefined(made(30, 200, [](int, int x) { return 800 + 6 * x; }), "ramp");
  expectAsDefined(made(200, 30, [](int y, int) { return 800 + 6 * y; }), "ramp down");
  expectAsDefined(made(40, 60, [](int, int) { return 65535; }), "65535");
  expectAsDefined(made(30, 40, [](int, int) { return 0; }), "all unknown");
  expectAsDefined(made(40, 60, [&](int, int) { return random.uniform(500, 5000); }), "noise");
  expectAsDefined(made(40, 60, [&](int, int) { return random.uniform(500, 520); }), "slight noise");
  expectAsDefined(made(40, 60, [&](int, int) { return random.uniform(0, 4) * 700; }), "few values and holes");
  expectAsDefined(
      made(60, 80, [&](int y, int x) { return (x > 40 ? 900 + 3 * y : 2500) + random.uniform(-3, 4); }),
      "noisy planes");
  expectAsDefined(made(1, 50, [](int, int x) { return 600 + 20 * (x % 7); }), "one row");
  expectAsDefined(made(50, 1, [](int y, int) { return 600 + 20 * (y % 7); }), "one column");
  expectAsDefined(made(1, 1, [](int, int) { return 1000; }), "one pixel");
}

TEST(DofSegmentation, LabelsAreThoseOfTheDefinitionOnRandomBlocks) {
  for (int seed = 1; seed <= 60; ++seed) {
    cv::RNG random(seed);
    cv::Mat depth(37, 53, CV_16UC1, cv::Scalar(random.uniform(800, 4000)));
    for (int i = 0; i < 30; ++i) {
      const cv::Rect block(random.uniform(0, 45), random.uniform(0, 30), random.uniform(1, 9),
                           random.uniform(1, 7));
      depth(block) = random.uniform(0, 6) == 0 ? 0 : random.uniform(600, 1200);
    }
    expectAsDefined(depth, ("seed " + std::to_string(seed)).c_str());
  }
}

TEST(DofSegmentation, NearToFarFromOne) {
  const Segmentation result = segment(made(20, 60, [](int, int x) {
    return x < 20 ? 4000 : x < 40 ? 900 : 1500;
  }));
  ASSERT_EQ(result.segments.size(), 3u);
  EXPECT_EQ(result.labels.at<std::int32_t>(5, 5), 3);
  EXPECT_EQ(result.labels.at<std::int32_t>(5, 25), 1);
  EXPECT_EQ(result.labels.at<std::int32_t>(5, 45), 2);
  EXPECT_EQ(result.segments[0].median_mm, 900);
  EXPECT_EQ(result.segments[0].area, 400);
}

TEST(DofSegmentation, EqualMediansByFirstPixel) {
  const Segmentation result = segment(made(5, 9, [](int, int x) { return x % 4 == 3 ? 0 : 1000; }));
  ASSERT_EQ(result.segments.size(), 3u);
  EXPECT_EQ(result.labels.at<std::int32_t>(0, 0), 1);
  EXPECT_EQ(result.labels.at<std::int32_t>(0, 4), 2);
  EXPECT_EQ(result.labels.at<std::int32_t>(0, 8), 3);
}

TEST(DofSegmentation, EveryRegionOfARampFitsTheRule) {
  const Segmentation result = segment(made(60, 600, [](int, int x) { return 800 + 4 * x; }));
  EXPECT_GT(result.segments.size(), 4u);
  for (const Segment& s : result.segments) EXPECT_LT(s.max_mm - s.min_mm, maxDof({}, s.min_mm, s.max_mm));
}

TEST(DofSegmentation, SmallRegionsGoAgainstTheRuleOnlyIfAsked) {
  cv::Mat depth = made(20, 20, [](int, int) { return 1000; });
  depth(cv::Rect(8, 8, 3, 3)) = 3000;  // nine pixels
  SegmentationConfig config;
  EXPECT_EQ(segment(depth, config).segments.size(), 2u);
  config.merge_against_rule = true;
  const Segmentation merged = segment(depth, config);
  ASSERT_EQ(merged.segments.size(), 1u);
  EXPECT_FALSE(merged.segments[0].fits);  // told from all pixels
  EXPECT_EQ(merged.segments[0].max_mm, 3000);
  config.min_region_size = 9;
  EXPECT_EQ(segment(depth, config).segments.size(), 2u);
}

TEST(DofSegmentation, BuffersOfALargerImageDoNotShow) {
  DofSegmentation segmentation;
  Segmentation result;
  segmentation.compute(made(60, 80, [](int y, int x) { return 700 + 30 * y + x; }), result);
  segmentation.compute(made(10, 10, [](int, int) { return 1000; }), result);
  EXPECT_EQ(result.segments.size(), 1u);
  EXPECT_EQ(result.labels.size(), cv::Size(10, 10));
  EXPECT_EQ(result.unknown_area, 0);
}

TEST(DofSegmentation, RefusesWhatItCannotUse) {
  EXPECT_THROW(segment(cv::Mat()), std::invalid_argument);
  EXPECT_THROW(segment(cv::Mat(4, 4, CV_32FC1)), std::invalid_argument);
  EXPECT_THROW(DofSegmentation(SegmentationConfig{{0, 4, 0.019}}), std::invalid_argument);
  EXPECT_THROW(DofSegmentation(SegmentationConfig{{}, DofSpan::kPaper, -1}), std::invalid_argument);
  // A focal length beyond the scene: nothing could ever be sharp.
  EXPECT_THROW(segment(made(4, 4, [](int, int) { return 900; }), {{1000, 4, 0.019}}), std::invalid_argument);
}

}  // namespace
