// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "fusion/noise_estimation.hpp"

using namespace all_in_focus::core;

namespace {

// A smooth ramp, with texture of single pixels on its first `textured` columns, and noise on all of it.
cv::Mat noisyRamp(double deviation, int textured = 0, const cv::Size& size = {200, 120}, double slope = 0.4) {
  cv::RNG random(1);
  cv::Mat gray(size, CV_8UC1);
  for (int y = 0; y < gray.rows; ++y) {
    for (int x = 0; x < gray.cols; ++x) {
      const double value = x < textured ? random.uniform(30.0, 220.0) : 80 + slope * x + 0.1 * y;
      gray.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(value + random.gaussian(deviation));
    }
  }
  return gray;
}

// Large enough for a pyramid of several levels.
cv::Mat noisyPicture(double deviation, int textured) {
  return noisyRamp(deviation, textured, {640, 480}, 0.1);
}

TEST(NoiseSpectrum, FindsWhiteNoise) {
  for (const double deviation : {2.0, 5.0, 10.0}) {
    const NoiseSpectrum found = NoiseSpectrum::of(noisyPicture(deviation, 0));
    EXPECT_NEAR(found.deviation(), deviation, 0.15 * deviation);
    EXPECT_NEAR(found.sharpness(0), 3.909 * deviation, 0.1 * found.sharpness(0));
  }
}

TEST(NoiseSpectrum, TextureOnMostOfThePictureHardlyLiftsIt) {
  for (const double deviation : {1.0, 3.0, 10.0}) {
    const double plain = NoiseSpectrum::of(noisyPicture(deviation, 0)).sharpness(0);
    EXPECT_LT(NoiseSpectrum::of(noisyPicture(deviation, 480)).sharpness(0), 1.4 * plain)
        << deviation;  // 1.21
  }
}

TEST(NoiseSpectrum, FindsCorrelatedNoiseAtTheLevelOfItsCorrelation) {
  cv::Mat large;
  cv::resize(noisyPicture(5, 0), large, {}, 5, 5, cv::INTER_CUBIC);
  const NoiseSpectrum found = NoiseSpectrum::of(large);
  // White noise of that deviation would show more at level 0 than at level 2.
  EXPECT_LT(found.sharpness(0), 2);  // 1.0
  EXPECT_GT(found.sharpness(2), 4);  // 5.3
  EXPECT_GT(found.deviation(), 2);   // 3.5
}

TEST(NoiseSpectrum, BlackAndWhiteHideNone) {
  cv::Mat gray = noisyPicture(5, 0);
  gray.colRange(0, 200) = 0;
  gray.colRange(200, 400) = 255;
  EXPECT_NEAR(NoiseSpectrum::of(gray).deviation(), 5, 1);
}

TEST(NoiseSpectrum, OfACoarseLevelItIsAtLeastAShareOfTheFinerOne) {
  const NoiseSpectrum noise({2, 3, 8});
  EXPECT_EQ(noise.sharpness(0), 2);
  EXPECT_EQ(noise.sharpness(1), 3);
  EXPECT_EQ(noise.sharpness(2), 8);
  EXPECT_NEAR(noise.sharpness(3), 3.2, 1e-9);
  EXPECT_EQ(NoiseSpectrum().sharpness(3), 0);
}

TEST(NoiseSpectrum, TheLeastOfTwoFramesIsTakenLevelByLevel) {
  const cv::Mat white = noisyPicture(4, 0);
  cv::Mat correlated;
  cv::resize(noisyPicture(25, 0)(cv::Rect(0, 0, 160, 120)), correlated, white.size(), 0, 0, cv::INTER_CUBIC);
  const NoiseSpectrum a = NoiseSpectrum::of(white), b = NoiseSpectrum::of(correlated);
  ASSERT_LT(b.sharpness(0), a.sharpness(0));
  ASSERT_LT(a.sharpness(2), b.sharpness(2));
  for (const NoiseSpectrum& least :
       {NoiseSpectrum::of(white, {correlated}), NoiseSpectrum::of(correlated, {white})}) {
    EXPECT_LE(least.sharpness(0), b.sharpness(0));
    EXPECT_LE(least.sharpness(2), a.sharpness(2));
  }
}

// Coarse texture everywhere, which both frames show alike, and noise of their own.
TEST(NoiseSpectrum, TextureThatTwoFramesShareIsNoNoise) {
  cv::Mat texture(120, 160, CV_8UC1), frames[3];  // the last one is blurred
  cv::RNG random(1);
  random.fill(texture, cv::RNG::UNIFORM, 20, 236);
  cv::resize(texture, texture, {640, 480}, 0, 0, cv::INTER_CUBIC);
  for (cv::Mat& frame : frames) {
    cv::Mat noise(texture.size(), CV_16SC1);
    random.fill(noise, cv::RNG::NORMAL, 0, 3);
    if (&frame == &frames[2]) cv::GaussianBlur(texture, texture, {}, 2);
    cv::add(texture, noise, frame, cv::noArray(), CV_8U);
  }
  EXPECT_GT(NoiseSpectrum::of(frames[0]).deviation(), 10);  // 23: texture counts
  EXPECT_NEAR(NoiseSpectrum::of(frames[0], {frames[1]}).deviation(), 3, 0.5);
  EXPECT_GT(NoiseSpectrum::of(frames[0], {frames[2]}).deviation(), 5);  // 6.7: so does what blur took
  EXPECT_NEAR(NoiseSpectrum::of(frames[0], {frames[2], frames[1]}).deviation(), 3, 0.5);

  // Where both are white they do not differ, and that is not counted.
  for (cv::Mat& frame : frames) frame.colRange(0, 320) = 255;
  EXPECT_NEAR(NoiseSpectrum::of(frames[0], {frames[1]}).deviation(), 3, 0.5);
}

TEST(NoiseSpectrum, AFrameThatIsBlackOrWhiteDoesNotCount) {
  const cv::Mat noisy = noisyPicture(5, 0);
  const NoiseSpectrum alone = NoiseSpectrum::of(noisy);
  for (const int level : {0, 255}) {
    const cv::Mat flat(noisy.size(), CV_8UC1, cv::Scalar(level));
    for (const NoiseSpectrum& noise : {NoiseSpectrum::of(noisy, {flat}), NoiseSpectrum::of(flat, {noisy})}) {
      for (std::size_t l = 0; l < 4; ++l) EXPECT_EQ(noise.sharpness(l), alone.sharpness(l));
    }
  }
}

TEST(NoiseSpectrum, SmallImagesHaveNone) {
  EXPECT_EQ(NoiseSpectrum::of(cv::Mat(3, 3, CV_8UC1, cv::Scalar(7))).deviation(), 0);
  EXPECT_EQ(NoiseSpectrum::of(cv::Mat(1, 1, CV_8UC1, cv::Scalar(7))).sharpness(0), 0);
  const cv::Mat small(3, 3, CV_8UC1, cv::Scalar(7));
  EXPECT_EQ(NoiseSpectrum::of(small, {small}).deviation(), 0);
}

}  // namespace
