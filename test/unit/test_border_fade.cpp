// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <vector>

#include "fusion/weighted_mean.hpp"

using namespace all_in_focus::core;

namespace {

const cv::Size kSize(640, 480);
const cv::Rect kWhole({}, kSize);

struct Frame {
  int code;
  float sharpness;
  cv::Rect seen;
};

// Red of the mean.
cv::Mat meanOf(const std::vector<Frame>& frames) {
  WeightedMean mean;
  mean.begin(kSize, 0, {});
  for (const Frame& frame : frames) {
    mean.beginFrame(frame.code, {});
    const cv::Range columns(frame.seen.x, frame.seen.br().x), rows(frame.seen.y, frame.seen.br().y);
    const std::vector<float> fade_x = fadeAlong(columns, kSize.width), fade_y = fadeAlong(rows, kSize.height);
    const cv::Mat picture(kSize, CV_8UC3, cv::Scalar::all(frame.code));
    for (int y = frame.seen.y; y < frame.seen.br().y; ++y) {
      const std::vector<float> sharpness(kSize.width, frame.sharpness);
      std::vector<float> parts = fade_x;
      for (float& part : parts) part *= fade_y[y];
      mean.addRow(y, columns, picture, {sharpness.data(), nullptr, parts.data()});
    }
  }
  cv::Mat red;
  cv::extractChannel(mean.image(CV_8U), red, 2);
  return red;
}

int highestStep(const cv::Mat& codes) {
  int highest = 0;
  for (int i = 1; i < static_cast<int>(codes.total()); ++i)
    highest = std::max(highest, std::abs(codes.at<uchar>(i) - codes.at<uchar>(i - 1)));
  return highest;
}

TEST(BorderFade, WholeFramesDoNotFade) {
  for (const float part : fadeAlong({0, kSize.width}, kSize.width)) EXPECT_EQ(part, 1);
}

// However much sharper the frame is.
TEST(BorderFade, AFrameThatEndsWithinThePictureLeavesNoSeam) {
  for (const float sharpness : {1.3f, 2.0f, 4.0f, 10.0f}) {
    for (const cv::Rect& seen :
         {cv::Rect(16, 0, 624, 480), cv::Rect(0, 0, 624, 480), cv::Rect(0, 16, 640, 464),
          cv::Rect(0, 0, 640, 464), cv::Rect(16, 16, 608, 448)}) {
      const Frame whole = {0, 1, kWhole}, part = {100, sharpness, seen};
      const cv::Mat mean = meanOf({whole, part});
      EXPECT_LE(highestStep(mean.row(240)), 14) << sharpness << seen;
      EXPECT_LE(highestStep(mean.col(320).clone()), 14) << sharpness << seen;
      EXPECT_GE(mean.at<uchar>(240, 320), sharpness < 2 ? 85 : 99);
    }
  }
}

// A third frame takes the place of the one that ends.
TEST(BorderFade, TheNextBestFrameTakesItsPlace) {
  const cv::Rect seen(16, 0, 624, 480);
  const cv::Mat mean = meanOf({{0, 1, kWhole}, {200, 8, seen}, {100, 3, kWhole}});
  EXPECT_EQ(mean.at<uchar>(9, 15), 100);
  EXPECT_NEAR(mean.at<uchar>(9, 16), 100, 5);
  EXPECT_EQ(mean.at<uchar>(9, 24), 200);
}

// Nothing changes far from the end; what only this frame shows, it shows to its end.
TEST(BorderFade, OnlyTheEndFades) {
  const cv::Rect seen(16, 0, 624, 480), other(0, 0, 300, 480);
  const cv::Mat mean = meanOf({{0, 1, other}, {100, 2, seen}});
  const cv::Mat whole = meanOf({{0, 1, kWhole}, {100, 2, kWhole}});
  EXPECT_EQ(cv::norm(mean.colRange(24, 300), whole.colRange(24, 300), cv::NORM_INF), 0);
  EXPECT_EQ(cv::countNonZero(mean.colRange(300, 640) != 100), 0);
}

}  // namespace
