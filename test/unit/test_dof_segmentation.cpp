// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

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

void expectSame(const Segmentation& result, const Segmentation& expected, const std::string& what) {
  ASSERT_EQ(result.segments.size(), expected.segments.size()) << what;
  ASSERT_EQ(cv::countNonZero(result.labels != expected.labels), 0) << what;
  ASSERT_EQ(result.unknown_area, expected.unknown_area) << what;
  for (std::size_t i = 0; i < expected.segments.size(); ++i) {
    const Segment &a = result.segments[i], &b = expected.segments[i];
    ASSERT_EQ(std::tie(a.label, a.area, a.min_mm, a.max_mm, a.median_mm, a.fits),
              std::tie(b.label, b.area, b.min_mm, b.max_mm, b.median_mm, b.fits))
        << what << ", label " << b.label;
  }
}

struct Threads {
  explicit Threads(int count) { cv::setNumThreads(count); }
  ~Threads() { cv::setNumThreads(-1); }
};

// Both modes, both spans, any number of threads; buffers go on from image to image.
void expectAsDefined(const cv::Mat& depth, const std::string& what) {
  static std::vector<DofSegmentation> segmentations;
  if (segmentations.empty()) {
    for (const bool against_rule : {false, true}) {
      for (const DofSpan span : {DofSpan::kPaper, DofSpan::kFull})
        segmentations.emplace_back(SegmentationConfig{{24, 4, 0.019}, span, 10, against_rule});
    }
  }
  static Segmentation result;
  for (DofSegmentation& segmentation : segmentations) {
    const Segmentation expected = referenceSegmentation(depth, segmentation.config());
    for (const int threads : {1, 2, 5}) {
      if (threads > 1 && depth.rows < 64) continue;  // one thread has them all
      const Threads limited(threads);
      segmentation.compute(depth, result);
      ASSERT_NO_FATAL_FAILURE(expectSame(
          result, expected,
          what + ", against the rule: " + std::to_string(segmentation.config().merge_against_rule) +
              ", full span: " + std::to_string(segmentation.config().span == DofSpan::kFull) +
              ", threads: " + std::to_string(threads)));
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

// A scene of one of many kinds: surfaces and blocks, noise, quantisation as by a Kinect, holes.
cv::Mat randomScene(cv::RNG& random, int rows, int cols) {
  const int kind = random.uniform(0, 11);
  const int base = random.uniform(600, 4000), spread = 1 << random.uniform(0, 11);
  const double noise = random.uniform(0, 2) * random.uniform(0.0, 8.0);
  const double slope_x = random.uniform(-8.0, 8.0), slope_y = random.uniform(-8.0, 8.0);
  const bool holes = random.uniform(0, 2) == 0, quantised = random.uniform(0, 3) == 0;
  cv::Mat blocks(rows, cols, CV_16UC1, cv::Scalar(0));
  for (int i = random.uniform(0, 8); i > 0; --i) {
    const cv::Rect block(random.uniform(0, cols), random.uniform(0, rows), random.uniform(1, 12),
                         random.uniform(1, 12));
    blocks(block & cv::Rect(0, 0, cols, rows)) = random.uniform(1, 2000);
  }
  return made(rows, cols, [&](int y, int x) {
    if (holes && random.uniform(0, 12) == 0) return 0;
    double z = base;
    if (kind == 0) z = 65535 - random.uniform(0, 3) * random.uniform(0, 30000);
    if (kind == 1) z = base + (x + y) % 2 * spread;
    if (kind == 2) z = base + random.uniform(0, 2) * spread;
    if (kind == 3) z = base + random.uniform(0, spread);
    if (kind == 4) z = random.uniform(100, 65536);
    if (kind >= 5) z = base + slope_x * x + slope_y * y + random.gaussian(noise);
    if (kind >= 7) z += blocks.at<std::uint16_t>(y, x);
    if (kind == 10)
      z = x < cols / 2 ? base + 9 * slope_x * x + 9 * slope_y * y : base + random.uniform(0, spread);
    z = std::max(z, 30.0);
    if (quantised) z = 348000 / std::max(1.0, std::round(348000 / z));
    return static_cast<int>(z);
  });
}

TEST(DofSegmentation, LabelsAreThoseOfTheDefinitionOnSmallScenes) {
  for (int seed = 1; seed <= 4000; ++seed) {
    cv::RNG random(seed);
    const int rows = random.uniform(1, 14), cols = random.uniform(1, 20);
    const cv::Mat depth = randomScene(random, rows, cols);
    ASSERT_NO_FATAL_FAILURE(expectAsDefined(depth, "seed " + std::to_string(seed)));
  }
}

TEST(DofSegmentation, LabelsAreThoseOfTheDefinitionInSequences) {
  for (int seed = 1; seed <= 300; ++seed) {
    cv::RNG random(seed);
    const int rows = random.uniform(9, 35), cols = random.uniform(9, 35);
    for (int image = 0; image < 8; ++image) {
      const cv::Mat depth = randomScene(random, rows, cols);
      ASSERT_NO_FATAL_FAILURE(
          expectAsDefined(depth, "seed " + std::to_string(seed) + ", image " + std::to_string(image)));
    }
  }
}

TEST(DofSegmentation, LabelsAreThoseOfTheDefinitionOnAnyNumberOfThreads) {
  for (int seed = 1; seed <= 60; ++seed) {
    cv::RNG random(seed);
    const int rows = random.uniform(64, 200), cols = random.uniform(1, 70);
    const cv::Mat depth = randomScene(random, rows, cols);
    ASSERT_NO_FATAL_FAILURE(expectAsDefined(depth, "seed " + std::to_string(seed)));
  }
}

TEST(DofSegmentation, LabelsAreThoseOfTheDefinitionOnPartOfAnImage) {
  const cv::Mat depth = made(80, 90, [](int y, int x) { return 700 + 3 * x + (y / 7) * 20; });
  expectAsDefined(depth(cv::Rect(7, 5, 61, 70)), "rows with gaps");
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
    ASSERT_NO_FATAL_FAILURE(expectAsDefined(depth, "seed " + std::to_string(seed)));
  }
}

// Zones that reach over several regions are found again by lower limits, some of them more than once.
TEST(DofSegmentation, LabelsAreThoseOfTheDefinitionOnNoisySlopes) {
  cv::RNG random(5);
  for (int image = 0; image < 100; ++image) {
    const double slope_x = random.uniform(-6.0, 6.0), slope_y = random.uniform(-6.0, 6.0);
    const double noise = random.uniform(1.0, 20.0);
    cv::Mat boards(70, 100, CV_32S, cv::Scalar(900));
    for (int i = 0; i < 3; ++i) {
      const cv::Rect board(random.uniform(0, 80), random.uniform(0, 60), random.uniform(5, 60),
                           random.uniform(5, 60));
      boards(board & cv::Rect(0, 0, 100, 70)) = random.uniform(700, 1200);
    }
    const auto depth = [&](int y, int x) {
      const double z = boards.at<int>(y, x) + slope_x * x + slope_y * y + random.gaussian(noise);
      return std::max(100, static_cast<int>(z));
    };
    ASSERT_NO_FATAL_FAILURE(expectAsDefined(made(70, 100, depth), "image " + std::to_string(image)));
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
