// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
// The darker of two frames counts more, whatever noise does.
#include <gtest/gtest.h>

#include <cstdint>

#include "fusion/brightness_penalty.hpp"

namespace all_in_focus::core {
namespace {

// In the middle of a picture of 5 x 5 px.
float penaltyOf(const cv::Mat& gray, double noise = 0, bool resampled = false) {
  const BrightnessPenalty penalty = brightnessPenalty(gray, noise, resampled);
  return penalty.of_level[penalty.level.at<std::uint8_t>(2, 2)];
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
  EXPECT_FLOAT_EQ(penaltyOf(flat(0)), 1);
  EXPECT_FLOAT_EQ(penaltyOf(flat(60)), 0.125f);
}

TEST(BrightnessPenalty, WithoutNoiseOnePixelIsDark) {
  EXPECT_FLOAT_EQ(penaltyOf(darkPixelOn(200)), 1);
}

TEST(BrightnessPenalty, ADarkPixelOfNoiseOrRingingIsNotPreferred) {
  EXPECT_FLOAT_EQ(penaltyOf(darkPixelOn(200), 2), penaltyOf(flat(200)));
  EXPECT_FLOAT_EQ(penaltyOf(darkPixelOn(200), 0, true), penaltyOf(flat(200)));
}

TEST(BrightnessPenalty, WithSomeNoiseTheMedianCountsForAPart) {
  EXPECT_FLOAT_EQ(penaltyOf(darkPixelOn(200), 1), penaltyOf(flat(100)));
}

}  // namespace
}  // namespace all_in_focus::core
