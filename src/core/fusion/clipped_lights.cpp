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
const cv::Size kAround(13, 13);       // of these pixels
constexpr double kMostWhite = 0.15;   // share of the pixels around; a bright sky or wall is no light

// Of a light brighter than white: what is white in a frame over what is nearly white in the fused picture.
// (1.5: gardens without depth up to 0.04 dB less.)
constexpr double kGrows = 1.2;
constexpr int kNearlyWhite = 242;  // noise is left out (250: planes_noise2 restored -0.1 dB)

}  // namespace

cv::Mat clippedLights(const cv::Mat& gray) {
  const cv::Mat white = gray >= kWhite;
  if (cv::countNonZero(white) == 0) return {};
  const double scale = std::max(1.0, gray.cols / kWidth);
  const cv::Size size(cvRound(gray.cols / scale), std::max(1, cvRound(gray.rows / scale)));
  cv::Mat blocks, block_share, white_share, lights;
  const int block = std::max(2, cvRound(kBlock * gray.cols));
  cv::erode(white, blocks, cv::Mat::ones(block, block, CV_8U));
  cv::resize(blocks, block_share, size, 0, 0, cv::INTER_AREA);
  cv::resize(white, white_share, size, 0, 0, cv::INTER_AREA);
  cv::blur(white_share, white_share, kAround);
  lights = (block_share > 0) & (white_share < 255 * kMostWhite);
  if (cv::countNonZero(lights) == 0) return {};
  cv::dilate(lights, lights, cv::getStructuringElement(cv::MORPH_ELLIPSE, kAround));
  return lights;
}

cv::Mat lightsBeyondWhite(const cv::Mat& gray, const std::vector<cv::Mat>& frames) {
  const cv::Mat lights = clippedLights(gray);
  if (lights.empty()) return {};
  const auto whiteAround = [&](const cv::Mat& image, int least) {
    cv::Mat share;
    cv::Mat(image >= least).convertTo(share, CV_32F);
    cv::resize(share, share, lights.size(), 0, 0, cv::INTER_AREA);
    cv::blur(share, share, kAround);
    return share;
  };
  cv::Mat most = cv::Mat::zeros(lights.size(), CV_32FC1);
  for (const cv::Mat& frame : frames) cv::max(most, whiteAround(frame, kWhite), most);
  return (most > kGrows * whiteAround(gray, kNearlyWhite)) & lights;
}

}  // namespace all_in_focus::core
