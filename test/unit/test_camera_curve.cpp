// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
// Blurred texture tells whether codes are sRGB or in proportion to light.
#include <gtest/gtest.h>

#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "restoration/camera_curve.hpp"

namespace all_in_focus::core {
namespace {

const cv::Size kSize(320, 240);
const cv::Rect kAll({}, kSize);

// Black and white squares of light, with a dim right half.
cv::Mat3f checkerboard() {
  cv::Mat3f light(kSize);
  for (int y = 0; y < light.rows; ++y) {
    for (int x = 0; x < light.cols; ++x) {
      const float white = x < light.cols / 2 ? 0.9f : 0.3f;
      light(y, x) = cv::Vec3f::all((x / 4 + y / 4) % 2 > 0 ? white : 0.02f);
    }
  }
  return light;
}

cv::Mat3b shown(const cv::Mat3f& light, const LightCurve& curve) {
  cv::Mat3b codes(light.size());
  for (int y = 0; y < light.rows; ++y) {
    for (int x = 0; x < light.cols; ++x) {
      for (int c = 0; c < 3; ++c)
        codes(y, x)[c] = static_cast<std::uint8_t>(curve.code(light(y, x)[c]) + 0.5f);
    }
  }
  return codes;
}

// A bracket of which each frame shows half of the scene blurred.
std::vector<cv::Mat> halfBlurred(const LightCurve& curve) {
  std::vector<cv::Mat> frames;
  for (const int x : {0, kSize.width / 2}) {
    cv::Mat3f light = checkerboard(), blurred;
    cv::GaussianBlur(light, blurred, {}, 4);
    const cv::Rect half(x, 0, kSize.width / 2, kSize.height);
    blurred(half).copyTo(light(half));
    frames.push_back(shown(light, curve));
  }
  return frames;
}

TEST(CameraCurve, IsTheOneThatKeepsTheSumOfLight) {
  for (const LightCurve* curve : {&LightCurve::srgb(), &LightCurve::proportional()})
    EXPECT_EQ(&cameraCurve(shown(checkerboard(), *curve), halfBlurred(*curve), {kAll, kAll}), curve);
}

TEST(CameraCurve, IsSrgbWhereNothingTells) {
  const cv::Mat flat(kSize, CV_8UC3, cv::Scalar::all(90));
  EXPECT_EQ(&cameraCurve(flat, {flat, flat}, {kAll, kAll}), &LightCurve::srgb());
  EXPECT_EQ(&cameraCurve(flat, {flat}, {cv::Rect(0, 0, 20, 20)}), &LightCurve::srgb());  // too little is seen
}

TEST(CameraCurve, PixelsThatAFrameDoesNotShowDoNotCount) {
  const LightCurve& curve = LightCurve::proportional();
  std::vector<cv::Mat> frames = halfBlurred(curve);
  const cv::Rect seen(20, 20, kSize.width - 40, kSize.height - 40);
  for (cv::Mat& frame : frames) {
    cv::Mat framed(kSize, CV_8UC3, cv::Scalar::all(0));
    frame(seen).copyTo(framed(seen));
    frame = framed;
  }
  EXPECT_EQ(&cameraCurve(shown(checkerboard(), curve), frames, {seen, seen}), &curve);
}

}  // namespace
}  // namespace all_in_focus::core
