// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/clipped_lights.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace all_in_focus::core {
namespace {

constexpr int kWhite = 250;           // gray levels
constexpr double kBlock = 2.0 / 640;  // of the width: side of a light; what is smaller may be texture
constexpr double kWidth = 320;        // of the result, px
constexpr int kReach = 6;             // of these pixels
constexpr double kMostWhite = 0.15;   // share of the pixels around; a bright sky or wall is no light

}  // namespace

cv::Mat clippedLights(const cv::Mat& gray) {
  const cv::Mat white = gray >= kWhite;
  if (cv::countNonZero(white) == 0) return {};
  const cv::Size window(2 * kReach + 1, 2 * kReach + 1);
  const double scale = std::max(1.0, gray.cols / kWidth);
  const cv::Size size(cvRound(gray.cols / scale), std::max(1, cvRound(gray.rows / scale)));
  cv::Mat blocks, block_share, white_share, lights;
  const int block = std::max(2, cvRound(kBlock * gray.cols));
  cv::erode(white, blocks, cv::Mat::ones(block, block, CV_8U));
  cv::resize(blocks, block_share, size, 0, 0, cv::INTER_AREA);
  cv::resize(white, white_share, size, 0, 0, cv::INTER_AREA);
  cv::blur(white_share, white_share, window);
  lights = (block_share > 0) & (white_share < 255 * kMostWhite);
  if (cv::countNonZero(lights) == 0) return {};
  cv::dilate(lights, lights, cv::getStructuringElement(cv::MORPH_ELLIPSE, window));
  return lights;
}

}  // namespace all_in_focus::core
