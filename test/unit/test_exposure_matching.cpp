// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "bracket_drawing.hpp"
#include "fusion/exposure_matching.hpp"

using namespace all_in_focus::core;

namespace {

double toLight(double code) {
  return code <= 0.04045 * 255 ? code / 255 / 12.92 : std::pow((code / 255 + 0.055) / 1.055, 2.4);
}

// The frame with another exposure: as the camera would have rounded it.
cv::Mat exposed(const cv::Mat& image, double gain) {
  cv::Mat codes(1, 256, CV_8UC1), out;
  for (int code = 0; code < 256; ++code)
    codes.at<uchar>(code) = cv::saturate_cast<uchar>(codeWithGain(code, gain));
  cv::LUT(image, codes, out);
  return out;
}

TEST(GainLut, IsAGainInLinearLight) {
  for (const int depth : {CV_8U, CV_16U}) {
    const std::vector<std::uint16_t> table = gainLut(1.3, depth);
    const int codes_per_gray = depth == CV_8U ? 1 : 257;
    ASSERT_EQ(table.size(), 255 * codes_per_gray + 1);
    EXPECT_EQ(table[0], 0);
    for (const int code : {3, 30, 100, 200}) {
      EXPECT_NEAR(toLight(codeWithGain(code, 1.3)), 1.3 * toLight(code), 1e-5) << code;
      EXPECT_NEAR(table[code * codes_per_gray], 257 * codeWithGain(code, 1.3), 0.5) << code;
    }
    EXPECT_EQ(table.back(), 65535);  // the reference would have clipped, too
    EXPECT_TRUE(gainLut(1, depth).empty());
  }
  for (int code = 0; code < 256; ++code) EXPECT_EQ(codeWithGain(code, 1), code);
}

TEST(ExposureMatching, FindsTheGainUnderChangesOfBlur) {
  const cv::Mat reference = bracket_drawing::frame({}, 0, 4);
  ExposureMatching matching;
  matching.setReference(reference);
  for (const double gain : {0.8, 0.95, 1.05, 1.2}) {
    cv::Mat frame = exposed(bracket_drawing::frame({}, 4, 0), 1 / gain);
    bracket_drawing::addNoise(3, 1, frame);
    EXPECT_NEAR(matching.gain(frame), gain, 0.005 * gain);
  }
}

TEST(ExposureMatching, IsExactlyOneWithoutAChange) {
  cv::Mat frame = bracket_drawing::frame({}, 4, 0);
  bracket_drawing::addNoise(5, 1, frame);
  ExposureMatching matching;
  matching.setReference(bracket_drawing::frame({}, 0, 4));
  EXPECT_EQ(matching.gain(frame), 1);
}

TEST(ExposureMatching, DoesNotTakeBlurOfCodesForExposure) {
  // A scene of nothing but texture, blurred as if codes were light: its mean light falls by 30 %.
  cv::Mat sharp(240, 320, CV_8UC1), blurred;
  cv::randu(sharp, 0, 250);
  cv::GaussianBlur(sharp, blurred, cv::Size(), 2);
  ExposureMatching matching;
  matching.setReference(sharp);
  EXPECT_EQ(matching.gain(blurred), 1);
}

TEST(ExposureMatching, DoesNotHeedClippedAndBlackParts) {
  cv::Mat reference = bracket_drawing::frame({});
  reference.colRange(0, 120) = 255;
  reference.colRange(120, 200) = 0;
  ExposureMatching matching;
  matching.setReference(reference);
  EXPECT_NEAR(matching.gain(exposed(reference, 0.9)), 1 / 0.9, 0.003);
}

TEST(ExposureMatching, IsBoundedAndOneWhereNothingIsSeen) {
  ExposureMatching matching;
  const cv::Mat plain(48, 64, CV_8UC1, cv::Scalar(200));
  matching.setReference(plain);
  EXPECT_EQ(matching.gain(exposed(plain, 0.1)), 2);
  EXPECT_EQ(matching.gain(cv::Mat(48, 64, CV_8UC1, cv::Scalar(0))), 1);
  EXPECT_EQ(matching.gain(cv::Mat(48, 64, CV_8UC1, cv::Scalar(255))), 1);
  matching.setReference(cv::Mat(3, 5, CV_8UC1, cv::Scalar(100)));
  EXPECT_EQ(matching.gain(cv::Mat(3, 5, CV_8UC1, cv::Scalar(120))), 1);
}

}  // namespace
