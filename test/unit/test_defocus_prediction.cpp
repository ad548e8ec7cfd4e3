// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "fusion/defocus_prediction.hpp"

using namespace all_in_focus::core;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kPitch = 0.03;
const Optics kOptics{50, 2, 0.03};
const cv::Size kSize(100, 60);

cv::Mat uniform(int depth_mm, const cv::Size& size = kSize) {
  return cv::Mat(size, CV_16UC1, cv::Scalar(depth_mm));
}

// The left half near, the right half far.
cv::Mat step(int near_mm, int far_mm, const cv::Size& size = kSize) {
  cv::Mat depth = uniform(far_mm, size);
  depth.colRange(0, size.width / 2) = near_mm;
  return depth;
}

// Of the size of the frames, as BracketFusion reads it.
cv::Mat errorOf(DefocusPrediction& prediction, double focus_mm, const cv::Size& size = kSize) {
  cv::Mat coarse, error;
  prediction.compute(focus_mm, coarse);
  cv::resize(coarse, error, size, 0, 0, cv::INTER_LINEAR);
  return error;
}

cv::Mat predict(const cv::Mat& depth, double focus_mm, const cv::Mat& measured = {},
                const cv::Size& size = kSize, double pitch = kPitch) {
  DefocusPrediction prediction;
  prediction.begin(depth, measured, size, kOptics, pitch);
  const cv::Mat error = errorOf(prediction, focus_mm, size);
  EXPECT_EQ(error.type(), CV_32FC1);
  EXPECT_EQ(error.size(), size);
  return error;
}

double expected(double depth_mm, double focus_mm, double pitch = kPitch, int columns = 640) {
  const double b = blurCircle(kOptics, depth_mm, focus_mm) / pitch;
  const double pixels = std::pow(4.0, std::round(std::log2(std::max(columns, 640) / 640.0)));
  return std::pow(36 * std::min(b * b / 32 / pixels, 4.0), 2);
}

void expectEverywhere(const cv::Mat& error, double value) {
  double least, most;
  cv::minMaxLoc(error, &least, &most);
  const double tolerance = 1e-4 * value + 1e-6;
  EXPECT_NEAR(least, value, tolerance);
  EXPECT_NEAR(most, value, tolerance);
}

TEST(DefocusPrediction, OfAPlaneIsTheBlurTimesTheLaplacian) {
  for (const double focus : {600.0, 1500.0, 2000.0, 2500.0, 9000.0, kInfinity}) {
    expectEverywhere(predict(uniform(2000), focus), expected(2000, focus));
  }
  EXPECT_GT(expected(2000, kInfinity), 1);
}

TEST(DefocusPrediction, AWideDiscChangesNoMoreThanTheContrast) {
  EXPECT_NEAR(expected(2000, 500), std::pow(36 * 4, 2), 1e-6);
  expectEverywhere(predict(uniform(2000), 500), expected(2000, 500));
  expectEverywhere(predict(uniform(2000), 300), expected(2000, 500));
}

TEST(DefocusPrediction, GrowsWithDefocusOnBothSides) {
  double before = -1;
  for (const double focus : {2000.0, 2100.0, 2500.0, 4000.0, kInfinity}) {
    const double error = predict(uniform(2000), focus).at<float>(30, 50);
    EXPECT_GT(error, before);
    before = error;
  }
  before = -1;
  for (const double focus : {2000.0, 1900.0, 1500.0, 700.0}) {
    const double error = predict(uniform(2000), focus).at<float>(30, 50);
    EXPECT_GT(error, before);
    before = error;
  }
}

TEST(DefocusPrediction, IsZeroInFocusAwayFromEdges) {
  const cv::Mat depth = step(1000, 3000);
  expectEverywhere(predict(depth, 1000).colRange(0, 30), 0);
  // Discs of the near half have a radius of 14 px, and the Gaussian in their place reaches farther.
  expectEverywhere(predict(depth, 3000).colRange(85, 100), 0);
  expectEverywhere(predict(depth, 1000).colRange(70, 100), expected(3000, 1000));
}

TEST(DefocusPrediction, NearerSurfacesGlowOverFartherOnes) {
  const cv::Mat error = predict(step(1000, 3000), 3000);
  // A disc of the near half has a radius of 14 px. A twelfth of it lies 10 px beyond the edge, half at the
  // edge.
  EXPECT_NEAR(std::sqrt(error.at<float>(30, 60)) / 72, 1.0 / 12, 0.04);
  EXPECT_GT(error.at<float>(30, 57), 2 * error.at<float>(30, 60));
  // The far half glows over nothing.
  expectEverywhere(predict(step(1000, 3000), 1000).colRange(0, 30), 0);
}

TEST(DefocusPrediction, WhatIsMuchBrighterOrDarkerGlowsMore) {
  const auto glow = [](int near, int far) {
    cv::Mat gray(kSize, CV_8UC1, cv::Scalar(far));
    gray.colRange(0, kSize.width / 2) = near;
    DefocusPrediction prediction;
    prediction.begin(step(1000, 3000), {}, kSize, kOptics, kPitch);
    prediction.setPicture(gray);
    return std::sqrt(errorOf(prediction, 3000).at<float>(30, 57));
  };
  const double alike = std::sqrt(predict(step(1000, 3000), 3000).at<float>(30, 57));
  constexpr double kRounding = 3 * 1.0;  // of discs in 8 bits
  EXPECT_NEAR(glow(100, 100), alike, kRounding);
  EXPECT_NEAR(glow(150, 100), alike * (72 + 3 * 50) / 72, kRounding);
  EXPECT_NEAR(glow(50, 100), alike * (72 + 3 * 50) / 72, kRounding);
}

TEST(DefocusPrediction, EveryFrameErrsBesideAnEdge) {
  const cv::Mat depth = step(1000, 3000);
  for (const double focus : {1000.0, 3000.0}) {
    const cv::Mat error = predict(depth, focus);
    EXPECT_GT(error.at<float>(30, 49), 0.01 * expected(1000, 3000));
    EXPECT_GT(error.at<float>(30, 50), 0.01 * expected(1000, 3000));
  }
}

TEST(DefocusPrediction, EdgesAreAsUncertainAsThePictureIsWide) {
  const auto reach = [](int width) {
    const cv::Size size(width, 20);
    const cv::Mat error = predict(step(1000, 3000, size), 1000, {}, size);
    const cv::Mat near = error.row(10).colRange(0, width / 2);
    return cv::countNonZero(near > 0.02 * expected(3000, 1000, kPitch, width));  // two deviations of the edge
  };
  constexpr double kDeviation = 2;
  EXPECT_NEAR(reach(640), 2 * kDeviation, kDeviation);
  EXPECT_NEAR(reach(2560), 8 * kDeviation, 2 * kDeviation);
}

TEST(DefocusPrediction, SlopesAreFollowed) {
  cv::Mat depth(kSize, CV_16UC1);
  for (int x = 0; x < kSize.width; ++x) depth.col(x) = 1000 + 20 * x;
  const cv::Mat error = predict(depth, 5000);
  for (const int x : {20, 50, 80}) {
    EXPECT_NEAR(error.at<float>(30, x), expected(1000 + 20 * x, 5000), 0.1 * expected(1000 + 20 * x, 5000));
  }
}

TEST(DefocusPrediction, UnknownDepthSpeaksForNoFrame) {
  cv::Mat depth = step(1000, 0);
  for (const double focus : {1000.0, 4000.0, kInfinity}) {
    const cv::Mat error = predict(depth, focus);
    expectEverywhere(error.colRange(70, 100), 0);
    expectEverywhere(error.colRange(0, 30), expected(1000, focus));
    expectEverywhere(predict(uniform(0), focus), 0);
  }
}

TEST(DefocusPrediction, UnknownFocusSpeaksNeitherForNorAgainstItsFrame) {
  const cv::Mat depth = step(1000, 0), error = predict(depth, kUnknownFocus);
  expectEverywhere(error.colRange(0, 30), error.at<float>(30, 20));
  EXPECT_GT(error.at<float>(30, 20), predict(depth, 1000).at<float>(30, 20));
  EXPECT_LT(error.at<float>(30, 20), predict(depth, 5000).at<float>(30, 20));
  expectEverywhere(error.colRange(70, 100), predict(depth, 1000).at<float>(30, 80));
}

TEST(DefocusPrediction, DepthThatNoLensReachesIsUnknown) {
  for (const int too_near : {1, 49, 50}) {
    const cv::Mat difference = predict(step(too_near, 2000), 3000) - predict(step(0, 2000), 3000);
    expectEverywhere(difference, 0);
  }
}

TEST(DefocusPrediction, FilledDepthIsTrustedLess) {
  const cv::Mat depth = uniform(2000), measured = step(0, 2000);
  for (const double focus : {2000.0, 4000.0}) {
    const cv::Mat error = predict(depth, focus, measured);
    expectEverywhere(error.colRange(0, 30), expected(2000, focus) + 100);
    expectEverywhere(error.colRange(70, 100), expected(2000, focus));
    expectEverywhere(predict(depth, focus), expected(2000, focus));
  }
}

TEST(DefocusPrediction, ThePixelPitchScalesTheBlur) {
  expectEverywhere(predict(uniform(2000), 1700, {}, kSize, kPitch / 2), expected(2000, 1700, kPitch / 2));
  EXPECT_NEAR(expected(2000, 1700, kPitch / 2), 16 * expected(2000, 1700), 1e-6 * expected(2000, 1700));
}

TEST(DefocusPrediction, DepthMayHaveAnySize) {
  for (const cv::Size& size : {cv::Size(1, 1), cv::Size(2, 1), cv::Size(50, 30), cv::Size(301, 179)}) {
    expectEverywhere(predict(uniform(2000, size), 3000, uniform(2000, size)), expected(2000, 3000));
  }
  for (const int columns : {50, 200, 400}) {
    const cv::Mat error = predict(step(1000, 3000, {columns, columns * 6 / 10}), 1000);
    expectEverywhere(error.colRange(0, 30), 0);
    expectEverywhere(error.colRange(70, 100), expected(3000, 1000));
  }
}

TEST(DefocusPrediction, FramesMayHaveAnySize) {
  for (const cv::Size& size : {cv::Size(1, 1), cv::Size(1, 7), cv::Size(7, 1), cv::Size(2, 3),
                               cv::Size(641, 3), cv::Size(1999, 5)}) {
    for (const cv::Mat& depth : {uniform(2000, size), uniform(2000, {13, 9})}) {
      expectEverywhere(predict(depth, 3000, {}, size), expected(2000, 3000, kPitch, size.width));
    }
  }
}

TEST(DefocusPrediction, CanBeginAnew) {
  DefocusPrediction prediction;
  prediction.begin(step(1000, 3000), step(0, 3000), kSize, kOptics, kPitch);
  errorOf(prediction, 1000);
  prediction.begin(uniform(2000, {20, 10}), {}, {50, 25}, kOptics, 2 * kPitch);
  cv::Mat coarse;
  prediction.compute(3000, coarse);
  EXPECT_EQ(coarse.size(), cv::Size(17, 9));  // cells of three pixels
  const cv::Mat error = errorOf(prediction, 3000, {50, 25});
  EXPECT_EQ(error.size(), cv::Size(50, 25));
  expectEverywhere(error, expected(2000, 3000, 2 * kPitch));
}

TEST(DefocusPrediction, BareSurfacesErrLessThanTexturedOnes) {
  DefocusPrediction prediction;
  prediction.begin(uniform(2000), {}, kSize, kOptics, kPitch);
  cv::Mat texture(30, 50, CV_32FC1, cv::Scalar(2));
  texture.colRange(0, 25) = 100;
  prediction.addTexture(texture, 1.6);  // noise that explains all of the bare side
  const cv::Mat error = errorOf(prediction, 1500);
  expectEverywhere(error.colRange(0, 40), expected(2000, 1500));
  // The noise may hide a Laplacian as large as its own.
  expectEverywhere(error.colRange(60, 100), expected(2000, 1500) * std::pow(1.6 / 36, 2));
  // What one frame has shown, later ones that are blurred do not take back.
  prediction.addTexture(cv::Mat(30, 50, CV_32FC1, cv::Scalar(0)), 0);
  EXPECT_EQ(cv::norm(error, errorOf(prediction, 1500), cv::NORM_INF), 0);
}

TEST(DefocusPrediction, TextureIsLookedForAtTheScaleOfTheSensor) {
  DefocusPrediction prediction;
  for (const auto& [width, level] : {std::pair(100, 1), {640, 1}, {1300, 2}, {6000, 4}}) {
    prediction.begin(uniform(2000), {}, {width, 60}, kOptics, kPitch);
    EXPECT_EQ(prediction.textureLevel(), level) << width;
  }
}

TEST(DefocusPrediction, TellsWhereDepthIsKnown) {
  DefocusPrediction prediction;
  prediction.begin(step(1000, 0, {640, 480}), {}, {640, 480}, kOptics, kPitch);
  cv::Mat known;
  cv::resize(prediction.known(), known, {320, 240}, 0, 0, cv::INTER_NEAREST);
  EXPECT_EQ(cv::countNonZero(known.colRange(0, 150)), 150 * 240);
  EXPECT_EQ(cv::countNonZero(known.colRange(180, 320)), 0);
}

}  // namespace
