// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
// The darker of two frames counts more, whatever noise does.
#include <gtest/gtest.h>

#include "fusion/brightness_penalty.hpp"
#include "fusion/sharpness_pyramid.hpp"

namespace all_in_focus::core {
namespace {

// In the middle of a picture of 5 x 5 px.
float penaltyOf(const cv::Mat& gray, double noise = 0, bool resampled = false) {
  SharpnessPyramid pyramid;
  const auto sharpness = [&](const cv::Mat& brightness) {
    SharpnessPyramid::Gauge gauge;
    gauge.brightness = brightness;
    pyramid.begin(cv::Mat::zeros(5, 5, CV_8UC1), gauge);
    return pyramid.compute({0, 5})(2, 2);
  };
  return sharpness(brightnessOf(gray, noise, resampled)) / sharpness({});
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
