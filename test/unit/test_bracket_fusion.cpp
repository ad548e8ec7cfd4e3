// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "all_in_focus/drawing.hpp"
#include "fusion/bracket_fusion.hpp"
#include "fusion/region_fusion.hpp"

using namespace all_in_focus::core;

namespace {

const cv::Size kSize(80, 60);

// Noise that is sharp on one half and blurred on the other.
cv::Mat halfSharp(bool left_sharp, int width = 80, int height = 60) {
  cv::Mat frame(height, width, CV_8UC3), blurred;
  cv::RNG random(3);
  random.fill(frame, cv::RNG::UNIFORM, 40, 200);
  cv::GaussianBlur(frame, blurred, {}, 2);
  const cv::Rect half(left_sharp ? width / 2 : 0, 0, width / 2, height);
  blurred(half).copyTo(frame(half));
  return frame;
}

cv::Mat halves(int left, int right, int width = 80, int height = 60) {
  cv::Mat labels(height, width, CV_32SC1, cv::Scalar(left));
  labels(cv::Rect(width / 2, 0, width / 2, height)) = right;
  return labels;
}

double differentPixels(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat difference;
  cv::absdiff(a, b, difference);
  return cv::countNonZero(difference.reshape(1));
}

TEST(NormalizedVariance, IsTheSumOfThePaper) {
  cv::RNG random(5);
  GraySums sums;
  std::vector<double> values;
  for (int i = 0; i < 1000; ++i) {
    const int g = random.uniform(0, 256);
    values.push_back(g);
    ++sums.n;
    sums.sum += g;
    sums.sum_of_squares += g * g;
  }
  double mean = 0, deviation = 0;
  for (const double g : values) mean += g / 1000;
  for (const double g : values) deviation += (g - mean) * (g - mean);
  EXPECT_NEAR(normalizedVariance(sums), deviation / (1000 * mean), 1e-9);
}

TEST(NormalizedVariance, FlatEmptyAndBlackAreZero) {
  EXPECT_EQ(normalizedVariance({}), 0);
  EXPECT_EQ(normalizedVariance({7, 0, 0}), 0);
  EXPECT_EQ(normalizedVariance({24000000, 24000000ull * 253, 24000000ull * 253 * 253}),
            0);  // exactly, however many
}

BracketScene regions(const cv::Mat& labels) {
  BracketScene scene;
  scene.labels = labels;
  return scene;
}

// Labels and depth of the two halves.
BracketScene nearAndFar() {
  BracketScene scene = regions(halves(1, 2));
  halves(1000, 3000).convertTo(scene.depth, CV_16U);
  return scene;
}

TEST(BracketFusion, EveryRegionFromItsSharpestFrame) {
  const cv::Mat near = halfSharp(true), far = halfSharp(false);
  BracketFusion fusion;
  fusion.begin(regions(halves(1, 2)), kSize, Mode::kPaper);
  EXPECT_EQ(fusion.add(far, 0), "");
  EXPECT_EQ(fusion.add(near, 1), "");
  const FusionResult result = fusion.result();
  const cv::Rect left(0, 0, 40, 60), right(40, 0, 40, 60);
  EXPECT_EQ(differentPixels(result.image(left), near(left)), 0);
  EXPECT_EQ(differentPixels(result.image(right), far(right)), 0);
  EXPECT_EQ(cv::countNonZero(result.source_index(left) != 1), 0);
  EXPECT_EQ(cv::countNonZero(result.source_index(right) != 0), 0);
  ASSERT_EQ(result.regions.size(), 2u);
  EXPECT_EQ(result.regions[0].label, 1);
  EXPECT_EQ(result.regions[0].frame, 1);
  EXPECT_GT(result.regions[0].margin, 0);
  EXPECT_LT(result.regions[0].margin, 1);
}

TEST(BracketFusion, SaysWhatItWentBy) {
  BracketFusion fusion;
  for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
    fusion.begin(nearAndFar(), kSize, mode);
    EXPECT_FALSE(fusion.bySharpnessAlone());
    fusion.begin({}, kSize, mode);
    EXPECT_TRUE(fusion.bySharpnessAlone());
  }
}

TEST(BracketFusion, TellsTheChoiceUnlessNobodyWantsIt) {
  for (const bool choice : {true, false}) {
    RefinedConfig config;
    config.choice = choice;
    BracketFusion fusion;
    fusion.begin(nearAndFar(), kSize, Mode::kRefined, config);
    fusion.add(halfSharp(true), 0);
    const FusionResult result = fusion.result();
    EXPECT_FALSE(result.image.empty());
    EXPECT_EQ(result.source_index.empty(), !choice);
    EXPECT_EQ(result.confidence.empty(), !choice);
    EXPECT_EQ(result.regions.empty(), !choice);
  }
}

TEST(BracketFusion, AnyLabelNumbersAreRegionsZeroToo) {
  for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
    BracketFusion fusion;
    fusion.begin(regions(halves(0, 65535)), kSize, mode);
    fusion.add(halfSharp(true), 0);
    fusion.add(halfSharp(false), 1);
    const FusionResult result = fusion.result();
    ASSERT_EQ(result.regions.size(), 2u);
    EXPECT_EQ(result.regions[0].label, 0);
    EXPECT_EQ(result.regions[0].frame, 0);
    EXPECT_EQ(result.regions[1].label, 65535);
    EXPECT_EQ(result.regions[1].frame, 1);
  }
}

TEST(BracketFusion, FirstOfEqualFramesWins) {
  const BracketScene with_labels = regions(halves(1, 2)), without_labels;
  for (const BracketScene& scene : {with_labels, without_labels}) {
    for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
      BracketFusion fusion;
      fusion.begin(scene, kSize, mode);
      for (int i = 0; i < 3; ++i) fusion.add(halfSharp(true), i);
      const FusionResult result = fusion.result();
      EXPECT_EQ(differentPixels(result.image, halfSharp(true)), 0);
      EXPECT_EQ(cv::countNonZero(result.source_index), 0);
      EXPECT_EQ(cv::countNonZero(result.confidence), 0);  // a draw
    }
  }
}

TEST(BracketFusion, LabelsAreScaledByNearestNeighbour) {
  BracketFusion fusion;
  fusion.begin(regions(halves(1, 2, 40, 30)), kSize, Mode::kPaper);
  fusion.add(halfSharp(true), 0);
  fusion.add(halfSharp(false), 1);
  const FusionResult result = fusion.result();
  EXPECT_EQ(cv::countNonZero(result.source_index(cv::Rect(0, 0, 40, 60)) != 0), 0);
  EXPECT_EQ(cv::countNonZero(result.source_index(cv::Rect(40, 0, 40, 60)) != 1), 0);
}

TEST(BracketFusion, WithoutLabelsEveryPixelFromItsSharpestFrame) {
  const cv::Mat near = halfSharp(true), far = halfSharp(false);
  const cv::Rect left(0, 0, 34, 60), right(46, 0, 34, 60);
  for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
    BracketFusion fusion;
    fusion.begin({}, kSize, mode);
    fusion.add(near, 0);
    fusion.add(far, 1);
    const FusionResult result = fusion.result();
    EXPECT_TRUE(result.regions.empty());
    EXPECT_EQ(cv::countNonZero(result.source_index(left) != 0), 0);
    EXPECT_EQ(cv::countNonZero(result.source_index(right) != 1), 0);
    if (mode == Mode::kPaper) {  // plainly copied
      EXPECT_EQ(differentPixels(result.image(left), near(left)), 0);
      EXPECT_EQ(differentPixels(result.image(right), far(right)), 0);
    }
  }
}

TEST(BracketFusion, ModePaperTakesNoNoticeOfDepth) {
  BracketScene with_depth = nearAndFar();
  with_depth.labels = cv::Mat();
  with_depth.camera = Camera{{80, 60}, 100, 100, 40, 30, {}};
  cv::Mat images[2];
  for (const bool depth : {false, true}) {
    BracketFusion fusion;
    fusion.begin(depth ? with_depth : BracketScene(), kSize, Mode::kPaper);
    fusion.add(halfSharp(true), 0, 3000);
    fusion.add(halfSharp(false), 1, 1000);
    images[depth] = fusion.result().image;
    EXPECT_TRUE(fusion.result().notes.empty());
  }
  EXPECT_EQ(differentPixels(images[0], images[1]), 0);
}

TEST(BracketFusion, OneFrameIsTheResult) {
  const cv::Mat frame = halfSharp(true);
  for (const BracketScene& scene : {nearAndFar(), BracketScene()}) {
    for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
      BracketFusion fusion;
      fusion.begin(scene, kSize, mode);
      fusion.add(frame, 4);
      EXPECT_EQ(differentPixels(fusion.result().image, frame), 0);
      EXPECT_EQ(cv::countNonZero(fusion.result().source_index != 4), 0);
      EXPECT_EQ(cv::countNonZero(fusion.result().confidence != 255), 0);
    }
  }
}

TEST(BracketFusion, ObservedFramesAreNotPartOfTheResult) {
  const cv::Mat frame = halfSharp(true);
  for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
    BracketFusion fusion;
    fusion.begin(nearAndFar(), kSize, mode);
    fusion.observe(halfSharp(false), 0, 1000);
    EXPECT_THROW(fusion.result(), std::logic_error);
    fusion.add(frame, 1, 2000);
    EXPECT_EQ(differentPixels(fusion.result().image, frame), 0);
    EXPECT_EQ(fusion.add(halfSharp(false), 0, 1000), "");
  }
}

TEST(BracketFusion, NotesWhatTheBracketDoesNotReach) {
  BracketFusion fusion;
  fusion.begin(nearAndFar(), kSize, Mode::kRefined);
  fusion.add(halfSharp(true), 0, 500);
  EXPECT_EQ(fusion.result().notes.size(), 2u);
  fusion.add(halfSharp(true), 1, 1000);
  EXPECT_EQ(fusion.result().notes.size(), 1u);
  fusion.add(halfSharp(false), 2, 3000);
  EXPECT_TRUE(fusion.result().notes.empty());
}

TEST(BracketFusion, TheNextBracketMayHaveAnotherSize) {
  for (const Mode mode : {Mode::kPaper, Mode::kRefined}) {
    BracketFusion fusion;
    fusion.begin(regions(halves(1, 2)), kSize, mode);
    fusion.add(halfSharp(true), 0);
    const FusionResult first = fusion.result();
    const cv::Mat kept = first.image.clone();
    fusion.begin(regions(halves(1, 2, 40, 30)), {40, 30}, mode);
    fusion.add(halfSharp(true, 40, 30), 0);
    EXPECT_EQ(fusion.result().image.size(), cv::Size(40, 30));
    EXPECT_EQ(differentPixels(first.image, kept), 0);  // results are the caller's own
  }
}

TEST(Drawing, LabelsAndWeights) {
  cv::Mat picture;
  drawLabels(halves(0, 1), 1, picture);
  EXPECT_EQ(picture.at<cv::Vec3b>(5, 5), cv::Vec3b(0, 0, 0));
  EXPECT_GT(picture.at<cv::Vec3b>(5, 70)[2], 200);  // the nearest region is red
  cv::Mat index(4, 4, CV_16UC1, cv::Scalar(kNoFrame)), confidence(4, 4, CV_8UC1, cv::Scalar(255));
  drawWeights(index, confidence, 0, picture);
  EXPECT_EQ(cv::countNonZero(picture.reshape(1)), 0);
  index.setTo(9);  // more than announced
  EXPECT_NO_THROW(drawWeights(index, confidence, 3, picture));
  EXPECT_THROW(drawWeights(confidence, index, 3, picture), std::invalid_argument);
}

}  // namespace
