// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "fusion/region_fusion.hpp"
#include "fusion/weighted_mean.hpp"

using namespace all_in_focus::core;

namespace {

const cv::Size kSize(40, 30);
const cv::Rect kWhole({}, kSize);

std::vector<std::uint16_t> asTheyAre() {
  return {};
}

cv::Mat randomFrame(int seed, double mean = 128, double deviation = 30) {
  cv::Mat frame(kSize, CV_8UC3);
  cv::RNG(seed).fill(frame, cv::RNG::NORMAL, mean, deviation);
  return frame;
}

cv::Mat plain(int value) {
  return cv::Mat(kSize, CV_8UC3, cv::Scalar::all(value));
}

cv::Mat everywhere(float value) {
  return cv::Mat(kSize, CV_32FC1, cv::Scalar(value));
}

// CV_32FC1 images; empty: says nothing.
struct Evidence {
  cv::Mat sharpness, squared_error;
};

Evidence sharpness(float value) {
  return {everywhere(value), {}};
}

void add(WeightedMean& mean, const cv::Mat& frame, const std::vector<std::uint16_t>& codes,
         const Evidence& evidence, const cv::Rect& inside, int index) {
  const auto row = [](const cv::Mat& image, int y) { return image.empty() ? nullptr : image.ptr<float>(y); };
  mean.beginFrame(index, codes);
  cv::parallel_for_({inside.y, inside.br().y}, [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      mean.addRow(y, {inside.x, inside.br().x}, frame,
                  {row(evidence.sharpness, y), row(evidence.squared_error, y)});
    }
  });
}

int largestDifference(const cv::Mat& a, const cv::Mat& b) {
  return static_cast<int>(cv::norm(a, b, cv::NORM_INF));
}

TEST(WeightedMean, OneFrameIsTheResult) {
  const cv::Mat frame = randomFrame(1);
  for (const bool soft : {true, false}) {
    for (const float value : {1.0f, 3.7f, 1e37f}) {
      WeightedMean mean;
      mean.begin(kSize, 2, {soft});
      add(mean, frame, asTheyAre(), sharpness(value), kWhole, 5);
      EXPECT_EQ(largestDifference(mean.image(CV_8U), frame), 0);
      EXPECT_EQ(cv::countNonZero(mean.sourceIndex() != 5), 0);
      EXPECT_EQ(cv::countNonZero(mean.confidence() != 255), 0);
    }
  }
}

TEST(WeightedMean, EqualFramesGiveThatFrame) {
  const cv::Mat frame = randomFrame(1);
  WeightedMean mean;
  mean.begin(kSize, 0, {});
  for (int i = 0; i < 100; ++i)
    add(mean, frame, asTheyAre(), sharpness(1 + static_cast<float>(i)), kWhole, i);
  EXPECT_EQ(largestDifference(mean.image(CV_8U), frame), 0);
}

TEST(WeightedMean, WeightsAreThePowersOfTheEvidence) {
  constexpr float kNoise = 1.5f;
  const float error_floor = 1 / 12.0f + 5 * kNoise * kNoise;
  const std::vector<Evidence> evidence = {{everywhere(8), everywhere(30)},
                                          {everywhere(10), everywhere(150)},
                                          {everywhere(9), everywhere(40)},
                                          {everywhere(2), everywhere(0)}};
  const int values[] = {40, 200, 90, 250};
  for (const bool backwards : {false, true}) {
    WeightedMean mean;
    mean.begin(kSize, kNoise, {});
    double sum = 0, sum_of_weights = 0;
    for (int k = 0; k < 4; ++k) {
      const int i = backwards ? 3 - k : k;
      add(mean, plain(values[i]), asTheyAre(), evidence[i], kWhole, i);
      const double weight = std::pow(evidence[i].sharpness.at<float>(0), 8) /
                            (evidence[i].squared_error.at<float>(0) + error_floor);
      sum += weight * values[i];
      sum_of_weights += weight;
    }
    EXPECT_EQ(largestDifference(mean.image(CV_8U), plain(cvRound(sum / sum_of_weights))), 0);
    EXPECT_EQ(cv::countNonZero(mean.sourceIndex() != 2), 0);
  }
}

TEST(WeightedMean, TheLessNoiseTheLessASofterFrameWeighs) {
  const auto shareOfSofter = [](double noise, const WeightedMean::Kind& kind) {
    WeightedMean mean;
    mean.begin(kSize, noise, kind);
    add(mean, plain(0), asTheyAre(), sharpness(10), kWhole, 0);
    add(mean, plain(200), asTheyAre(), sharpness(9), kWhole, 1);
    return cv::mean(mean.image(CV_8U))[0] / 200;
  };
  const auto shareAtPower = [](int power) { return std::pow(0.9, power) / (1 + std::pow(0.9, power)); };
  WeightedMean::Kind steep;
  steep.steep = true;
  constexpr double kStep = 0.5 / 200;
  EXPECT_NEAR(shareOfSofter(0, steep), shareAtPower(12), kStep);
  EXPECT_NEAR(shareOfSofter(0.23, steep), shareAtPower(9), 2 * kStep);
  EXPECT_NEAR(shareOfSofter(2, steep), shareAtPower(8), kStep);
  EXPECT_NEAR(shareOfSofter(0, {}), shareAtPower(8), kStep);
  WeightedMean::Kind resampled;
  resampled.resampled = true;
  const double weight = std::pow(0.9, 8) * (1.75 - 0.75 * std::pow(0.9, 4));
  EXPECT_NEAR(shareOfSofter(0, resampled), weight / (1 + weight), kStep);
}

TEST(WeightedMean, ThePredictedErrorCountsInUnitsOfTheNoise) {
  const auto shareOfBlurred = [](double noise) {
    WeightedMean mean;
    mean.begin(kSize, noise, {});
    add(mean, plain(0), asTheyAre(), {everywhere(10), everywhere(0)}, kWhole, 0);
    add(mean, plain(200), asTheyAre(), {everywhere(10), everywhere(1)}, kWhole, 1);
    return cv::mean(mean.image(CV_8U))[0] / 200;
  };
  EXPECT_LT(shareOfBlurred(0), 0.1);  // 1 gray level is much where there is only rounding
  EXPECT_GT(shareOfBlurred(1), 0.4);
}

TEST(WeightedMean, TheSharperFrameDominates) {
  WeightedMean mean;
  mean.begin(kSize, 0, {});
  add(mean, plain(0), asTheyAre(), sharpness(5), kWhole, 0);
  add(mean, plain(100), asTheyAre(), sharpness(20), kWhole, 1);
  EXPECT_LE(largestDifference(mean.image(CV_8U), plain(100)), 1);
  EXPECT_EQ(cv::countNonZero(mean.sourceIndex() != 1), 0);
  EXPECT_EQ(cv::countNonZero(mean.confidence() < 250), 0);
}

TEST(WeightedMean, ThePredictionDecidesWhereFramesAreEquallySharp) {
  WeightedMean mean;
  mean.begin(kSize, 0, {});
  for (int i = 0; i < 2; ++i) {
    add(mean, plain(100 * i), asTheyAre(), {everywhere(10), everywhere(i == 0 ? 1e4f : 0)}, kWhole, i);
  }
  EXPECT_LE(largestDifference(mean.image(CV_8U), plain(100)), 1);
}

TEST(WeightedMean, AveragesNoiseWhereFramesAgree) {
  constexpr int kFrames = 16;
  constexpr double kNoise = 8;
  WeightedMean mean;
  mean.begin(kSize, kNoise, {});
  for (int i = 0; i < kFrames; ++i) {
    add(mean, randomFrame(i + 1, 128, kNoise), asTheyAre(), sharpness(1), kWhole, i);
  }
  cv::Scalar average, deviation;
  cv::meanStdDev(mean.image(CV_8U).reshape(1), average, deviation);
  EXPECT_NEAR(deviation[0], kNoise / std::sqrt(kFrames), 0.15);
  EXPECT_EQ(cv::countNonZero(mean.confidence()), 0);   // a draw
  EXPECT_EQ(cv::countNonZero(mean.sourceIndex()), 0);  // the first
}

TEST(WeightedMean, LongBracketsKeepTheirMean) {
  constexpr int kFrames = 500;
  WeightedMean mean;
  mean.begin(kSize, 5, {});
  cv::Mat sum(kSize, CV_32FC3, cv::Scalar::all(0));
  for (int i = 0; i < kFrames; ++i) {
    const cv::Mat frame = randomFrame(i, 90, 5);
    add(mean, frame, asTheyAre(), sharpness(1), kWhole, i);
    cv::accumulate(frame, sum);
  }
  const cv::Mat difference = [&] {
    cv::Mat result;
    mean.image(CV_8U).convertTo(result, CV_32FC3);
    return cv::Mat(result - sum / kFrames);
  }();
  EXPECT_LT(cv::norm(difference, cv::NORM_INF), 0.6);  // half of it is the rounding of the result
  EXPECT_NEAR(cv::mean(difference)[0], 0, 0.03);
}

TEST(WeightedMean, HardChoiceCopiesTheHeaviest) {
  WeightedMean mean;
  mean.begin(kSize, 0, {false});
  for (int i = 0; i < 3; ++i) {
    add(mean, randomFrame(i + 1), asTheyAre(), sharpness(i == 1 ? 10.1f : 10), kWhole, i);
  }
  EXPECT_EQ(largestDifference(mean.image(CV_8U), randomFrame(2)), 0);
  EXPECT_EQ(cv::countNonZero(mean.sourceIndex() != 1), 0);
}

TEST(WeightedMean, ConfidenceIsTheSameForHardAndSoft) {
  cv::Mat confidence[2];
  for (const bool soft : {true, false}) {
    WeightedMean mean;
    mean.begin(kSize, 0, {soft});
    for (int i = 0; i < 3; ++i)
      add(mean, plain(i), asTheyAre(), sharpness(static_cast<float>(10 + i)), kWhole, i);
    confidence[soft] = mean.confidence();
  }
  EXPECT_EQ(largestDifference(confidence[0], confidence[1]), 0);
}

TEST(WeightedMean, CodesAreTheValuesThatCount) {
  std::vector<std::uint16_t> brighter(256, 0);
  brighter[100] = 257 * 150;
  brighter[200] = 257 * 255;
  WeightedMean mean;
  mean.begin(kSize, 0, {});
  add(mean, plain(100), asTheyAre(), sharpness(3), kWhole, 0);
  add(mean, plain(100), brighter, sharpness(3), kWhole, 1);
  EXPECT_EQ(largestDifference(mean.image(CV_8U), plain(125)), 0);
  mean.begin(kSize, 0, {});
  add(mean, plain(200), brighter, sharpness(3), kWhole, 0);
  EXPECT_EQ(largestDifference(mean.image(CV_8U), plain(255)), 0);
}

TEST(WeightedMean, AFrameCountsOnlyWhereItHasSeen) {
  const cv::Rect inside(10, 5, 20, 15);
  WeightedMean mean;
  mean.begin(kSize, 0, {});
  add(mean, plain(0), asTheyAre(), sharpness(1), kWhole, 0);
  add(mean, plain(200), asTheyAre(), sharpness(100), inside, 1);
  add(mean, plain(255), asTheyAre(), sharpness(200), cv::Rect(), 2);
  cv::Mat expected = plain(0), source(kSize, CV_16UC1, cv::Scalar(0));
  expected(inside) = cv::Scalar::all(200);
  source(inside) = 1;
  EXPECT_LE(largestDifference(mean.image(CV_8U), expected), 1);
  EXPECT_EQ(largestDifference(mean.sourceIndex(), source), 0);
}

TEST(WeightedMean, WhatNoFrameHasSeenIsBlack) {
  WeightedMean mean;
  mean.begin(kSize, 0, {});
  add(mean, plain(200), asTheyAre(), sharpness(1), cv::Rect(0, 0, 10, 30), 0);
  add(mean, plain(200), asTheyAre(), sharpness(1), cv::Rect(0, 0, 10, 30), 1);
  const cv::Rect unseen(10, 0, 30, 30);
  EXPECT_EQ(largestDifference(mean.image(CV_8U)(unseen), plain(0)(unseen)), 0);
  EXPECT_EQ(cv::countNonZero(mean.sourceIndex()(unseen) != kNoFrame), 0);
  EXPECT_EQ(cv::countNonZero(mean.confidence()(unseen)), 0);
}

TEST(WeightedMean, LongBracketsOfTheGreatestSharpnessDoNotOverflow) {
  WeightedMean mean;
  mean.begin(kSize, 0, {});
  for (int i = 0; i < 2000; ++i) {
    add(mean, plain(250), asTheyAre(), {everywhere(1e37f), everywhere(0)}, kWhole, i);
  }
  EXPECT_EQ(largestDifference(mean.image(CV_8U), plain(250)), 0);
}

TEST(WeightedMean, SharpnessMayDifferByAnyFactor) {
  for (const bool rising : {true, false}) {
    WeightedMean mean;
    mean.begin(kSize, 0, {});
    for (int i = 0; i < 38; ++i) {
      const int power = rising ? i : 37 - i;
      const Evidence evidence{everywhere(static_cast<float>(std::pow(10, power))), everywhere(1e10f)};
      add(mean, plain(5 * power), asTheyAre(), evidence, kWhole, power);
    }
    EXPECT_EQ(largestDifference(mean.image(CV_8U), plain(5 * 37)), 0);
    EXPECT_EQ(cv::countNonZero(mean.sourceIndex() != 37), 0);
  }
}

TEST(WeightedMean, DoesNotDependOnTheNumberOfThreads) {
  const int threads = cv::getNumThreads();
  cv::Mat images[2], confidences[2];
  for (int run = 0; run < 2; ++run) {
    cv::setNumThreads(run + 1);
    WeightedMean mean;
    mean.begin(kSize, 3, {});
    for (int i = 0; i < 9; ++i) {
      Evidence evidence;
      randomFrame(i + 50)
          .reshape(1, kSize.height)
          .colRange(0, kSize.width)
          .convertTo(evidence.sharpness, CV_32F, 1, 1);
      add(mean, randomFrame(i + 1), asTheyAre(), evidence, kWhole, i);
    }
    images[run] = mean.image(CV_8U);
    confidences[run] = mean.confidence();
  }
  cv::setNumThreads(threads);
  EXPECT_EQ(largestDifference(images[0], images[1]), 0);
  EXPECT_EQ(largestDifference(confidences[0], confidences[1]), 0);
}

TEST(WeightedMean, BuffersAreTheSameForEveryFrameAndBracket) {
  WeightedMean mean;
  const uchar* buffer = nullptr;
  for (int bracket = 0; bracket < 3; ++bracket) {
    mean.begin(kSize, 0, {});
    for (int i = 0; i < 20; ++i) {
      add(mean, plain(i), asTheyAre(), sharpness(1), kWhole, i);
      if (!buffer) buffer = mean.sourceIndex().data;
      EXPECT_EQ(mean.sourceIndex().data, buffer);
    }
  }
}

}  // namespace
