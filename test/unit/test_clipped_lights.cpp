// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "fusion/clipped_lights.hpp"

using namespace all_in_focus::core;

namespace {

cv::Mat dark(const cv::Size& size = {640, 480}) {
  return cv::Mat(size, CV_8UC1, cv::Scalar(80));
}

TEST(ClippedLights, AreSmallWhiteAreasAndWhatIsNear) {
  cv::Mat gray = dark();
  gray(cv::Rect(400, 100, 3, 3)) = 255;
  const cv::Mat lights = clippedLights(gray);
  ASSERT_EQ(lights.size(), cv::Size(320, 240));
  ASSERT_EQ(lights.type(), CV_8UC1);
  EXPECT_EQ(lights.at<uchar>(50, 200), 255);
  EXPECT_EQ(lights.at<uchar>(50, 205), 255);
  EXPECT_EQ(lights.at<uchar>(50, 210), 0);
  EXPECT_LT(cv::countNonZero(lights), 200);  // 148
}

TEST(ClippedLights, AreAsLargeInALargePicture) {
  cv::Mat gray = dark({3200, 2400});
  gray(cv::Rect(2000, 500, 15, 15)) = 255;
  const cv::Mat lights = clippedLights(gray);
  ASSERT_EQ(lights.size(), cv::Size(320, 240));
  EXPECT_EQ(lights.at<uchar>(50, 205), 255);
  EXPECT_EQ(lights.at<uchar>(50, 210), 0);
  gray = dark({3200, 2400});
  gray(cv::Rect(2000, 500, 5, 5)) = 255;  // a single pixel of a picture that was enlarged
  EXPECT_TRUE(clippedLights(gray).empty());
}

TEST(ClippedLights, AreNeitherSinglePixelsNorBrightWalls) {
  EXPECT_TRUE(clippedLights(dark()).empty());
  cv::Mat gray = dark();
  for (int x = 20; x < 600; x += 7) gray.at<uchar>(x % 400 + 20, x) = 255;
  EXPECT_TRUE(clippedLights(gray).empty());
  gray = dark();
  gray.colRange(0, 300) = 255;
  EXPECT_TRUE(clippedLights(gray).empty());
  gray = dark();
  gray(cv::Rect(400, 100, 3, 3)) = 240;
  EXPECT_TRUE(clippedLights(gray).empty());
}

TEST(ClippedLights, AreBeyondWhiteIfBlurAddsToTheirWhite) {
  cv::Mat gray = dark(), small, large;
  gray(cv::Rect(400, 100, 3, 3)) = 255;
  gray(cv::Rect(100, 300, 8, 8)) = 245;  // noise makes it white in a frame
  gray(cv::Rect(100, 320, 3, 3)) = 255;
  small = dark();
  small(cv::Rect(401, 101, 2, 2)) = 255;
  small(cv::Rect(100, 300, 8, 8)) = 255;
  small(cv::Rect(100, 320, 3, 3)) = 255;
  large = dark();
  large(cv::Rect(399, 99, 5, 5)) = 255;
  EXPECT_EQ(cv::countNonZero(lightsBeyondWhite(gray, {gray, small})), 0);
  const cv::Mat lights = lightsBeyondWhite(gray, {small, large});
  ASSERT_EQ(lights.size(), cv::Size(320, 240));
  EXPECT_EQ(lights.at<uchar>(50, 200), 255);
  EXPECT_EQ(lights.at<uchar>(160, 50), 0);
  EXPECT_TRUE(lightsBeyondWhite(dark(), {large}).empty());
}

TEST(ClippedLights, SmallPictures) {
  for (const cv::Size& size : {cv::Size(1, 1), {1, 700}, {700, 1}, {5, 3}}) {
    EXPECT_NO_THROW(clippedLights(dark(size)));
    EXPECT_NO_THROW(clippedLights(cv::Mat(size, CV_8UC1, cv::Scalar(255))));
  }
}

}  // namespace
