// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include "fusion/noise_estimation.hpp"

using namespace all_in_focus::core;

namespace {

// A smooth ramp, with texture of single pixels on its first `textured` columns.
cv::Mat noisyRamp(double deviation, int textured = 0) {
  cv::RNG random(1);
  cv::Mat gray(120, 200, CV_8UC1);
  for (int y = 0; y < gray.rows; ++y) {
    for (int x = 0; x < gray.cols; ++x) {
      const double value = x < textured ? random.uniform(30.0, 220.0) : 80 + 0.4 * x + 0.1 * y;
      gray.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(value + random.gaussian(deviation));
    }
  }
  return gray;
}

TEST(NoiseEstimation, FindsTheDeviationOnASmoothRamp) {
  for (int deviation = 2; deviation <= 10; ++deviation) {
    EXPECT_NEAR(noiseDeviation(noisyRamp(deviation)), deviation, 0.1 * deviation);
  }
}

TEST(NoiseEstimation, StrongTextureOnTwoFifthsHardlyLiftsIt) {
  EXPECT_LT(noiseDeviation(noisyRamp(0, 80)), 1);
  for (int deviation = 1; deviation <= 10; ++deviation) {
    // However strong, texture there can only shift the median of the rest to its upper sixth.
    EXPECT_LT(noiseDeviation(noisyRamp(deviation, 80)), 2.2 * deviation);
  }
}

TEST(NoiseEstimation, ConstantImagesHaveNone) {
  EXPECT_NEAR(noiseDeviation(cv::Mat(50, 50, CV_8UC1, cv::Scalar(77))), 0, 0.1);
}

TEST(NoiseEstimation, SmallImagesHaveNone) {
  for (const cv::Size& size : {cv::Size(0, 0), cv::Size(1, 1), cv::Size(2, 9), cv::Size(9, 2)}) {
    EXPECT_EQ(noiseDeviation(cv::Mat(size, CV_8UC1, cv::Scalar(7))), 0) << size;
  }
  EXPECT_NO_THROW(noiseDeviation(cv::Mat(3, 3, CV_8UC1, cv::Scalar(7))));
}

}  // namespace
