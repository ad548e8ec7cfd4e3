// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "util/linear_light.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace all_in_focus::core {
namespace {

constexpr int kReduction = 8;
constexpr double kSigma = 20;  // px

}  // namespace

cv::Mat linearLight(const cv::Mat& codes, const LightCurve& curve) {
  cv::Mat1f table(1, 256);
  for (int code = 0; code < 256; ++code) table(code) = curve.light(code);
  cv::Mat light;
  cv::LUT(codes, table, light);
  return light;
}

cv::Mat wideMean(const cv::Mat& light) {
  cv::Mat small;
  cv::resize(light, small, {std::max(1, light.cols / kReduction), std::max(1, light.rows / kReduction)}, 0, 0,
             cv::INTER_AREA);
  cv::GaussianBlur(small, small, {}, kSigma / kReduction, 0, cv::BORDER_REFLECT_101);
  return small;
}

}  // namespace all_in_focus::core
