// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
// Blurred texture tells whether codes are sRGB or in proportion to light.
#include <gtest/gtest.h>

#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "fusion/camera_curve.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {
namespace {

// Squares of light, dim in the right half.
cv::Mat1f checkerboard(const cv::Size& size, int square) {
  cv::Mat1f light(size);
  for (int y = 0; y < light.rows; ++y) {
    for (int x = 0; x < light.cols; ++x) {
      const float bright = x < light.cols / 2 ? 0.9f : 0.3f;
      light(y, x) = (x / square + y / square) % 2 > 0 ? bright : 0.02f;
    }
  }
  return light;
}

cv::Mat shown(const cv::Mat1f& light, const LightCurve& curve) {
  cv::Mat gray(light.size(), CV_8UC1);
  for (int y = 0; y < light.rows; ++y) {
    for (int x = 0; x < light.cols; ++x)
      gray.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(curve.code(light(y, x)) + 0.5f);
  }
  return gray;
}

// Shows the right half out of focus.
cv::Mat halfBlurred(const cv::Mat1f& light, double sigma, const LightCurve& curve) {
  cv::Mat1f blurred, half = light.clone();
  cv::GaussianBlur(light, blurred, {}, sigma);
  const cv::Rect right(light.cols / 2, 0, light.cols / 2, light.rows);
  blurred(right).copyTo(half(right));
  return shown(half, curve);
}

TEST(CameraCurve, IsTheOneThatKeepsTheSumOfLight) {
  for (const int scale : {1, 9}) {  // of a small picture and of a large one
    const cv::Mat1f light = checkerboard(cv::Size(320, 240) * scale, 4 * scale);
    for (const LightCurve* curve : {&LightCurve::srgb(), &LightCurve::linear()})
      EXPECT_EQ(hasLinearCodes(shown(light, *curve), {halfBlurred(light, 4 * scale, *curve)}),
                curve == &LightCurve::linear())
          << scale;
  }
}

TEST(CameraCurve, IsSrgbWhereNothingTells) {
  const cv::Mat flat(240, 320, CV_8UC1, cv::Scalar(90));
  EXPECT_FALSE(hasLinearCodes(flat, {flat, flat}));
  EXPECT_FALSE(hasLinearCodes(flat, {}));
  const cv::Mat1f tiny = checkerboard({40, 30}, 4);
  const LightCurve& linear = LightCurve::linear();
  EXPECT_FALSE(hasLinearCodes(shown(tiny, linear), {halfBlurred(tiny, 4, linear)}));
}

}  // namespace
}  // namespace all_in_focus::core
