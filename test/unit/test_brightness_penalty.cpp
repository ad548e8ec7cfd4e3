// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
// The darker of two frames counts more, in the exposure of the reference and whatever noise does.
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "fusion/brightness_penalty.hpp"

namespace all_in_focus::core {
namespace {

// In the middle of a picture of 5 x 5 px.
float penaltyOf(BrightnessPenalty& penalty, const cv::Mat& gray, double contrast = 1) {
  penalty.beginFrame(gray, contrast);
  std::vector<float> sharpness(gray.cols, 1.0f);
  penalty.weigh(2, sharpness.data());
  return sharpness[2];
}

cv::Mat flat(int level) {
  return {5, 5, CV_8UC1, cv::Scalar(level)};
}

cv::Mat darkPixelOn(int level) {
  cv::Mat gray = flat(level);
  gray.at<std::uint8_t>(2, 2) = 0;
  return gray;
}

TEST(BrightnessPenalty, FollowsItsFormula) {
  BrightnessPenalty penalty;
  penalty.begin(0, false);
  EXPECT_FLOAT_EQ(penaltyOf(penalty, flat(0)), 1);
  EXPECT_FLOAT_EQ(penaltyOf(penalty, flat(60)), 0.125f);
}

TEST(BrightnessPenalty, CountsInTheExposureOfTheReference) {
  BrightnessPenalty penalty;
  penalty.begin(0, false);
  EXPECT_FLOAT_EQ(penaltyOf(penalty, flat(120), 0.5f), penaltyOf(penalty, flat(60)));
  EXPECT_FLOAT_EQ(penaltyOf(penalty, flat(250), 2), penaltyOf(penalty, flat(255)));  // white stays white
}

TEST(BrightnessPenalty, WithoutNoiseOnePixelIsDark) {
  BrightnessPenalty penalty;
  penalty.begin(0, false);
  EXPECT_FLOAT_EQ(penaltyOf(penalty, darkPixelOn(200)), 1);
}

TEST(BrightnessPenalty, ADarkPixelOfNoiseOrRingingIsNotPreferred) {
  BrightnessPenalty noisy, resampled;
  noisy.begin(2, false);
  resampled.begin(0, true);
  EXPECT_FLOAT_EQ(penaltyOf(noisy, darkPixelOn(200)), penaltyOf(noisy, flat(200)));
  EXPECT_FLOAT_EQ(penaltyOf(resampled, darkPixelOn(200)), penaltyOf(resampled, flat(200)));
}

TEST(BrightnessPenalty, WithSomeNoiseTheMedianCountsForAPart) {
  BrightnessPenalty penalty;
  penalty.begin(1, false);
  EXPECT_FLOAT_EQ(penaltyOf(penalty, darkPixelOn(200)), penaltyOf(penalty, flat(100)));
}

}  // namespace
}  // namespace all_in_focus::core
