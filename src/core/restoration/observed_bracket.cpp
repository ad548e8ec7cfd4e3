// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/observed_bracket.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace all_in_focus::core {
double ObservedBracket::pxMm() const {
  double largest = 0;
  for (const ObservedFrame& frame : frames) largest = std::max(largest, frame.blur.px_mm);
  return largest;
}

cv::Mat1b jumps(const cv::Mat1f& inverse_depth, float gap) {
  cv::Mat1b found(inverse_depth.size(), 0);
  for (int y = 0; y < inverse_depth.rows; ++y) {
    for (int x = 0; x < inverse_depth.cols; ++x) {
      const float here = inverse_depth(y, x);
      if (x > 0 && std::abs(here - inverse_depth(y, x - 1)) > gap) found(y, x) = found(y, x - 1) = 255;
      if (y > 0 && std::abs(here - inverse_depth(y - 1, x)) > gap) found(y, x) = found(y - 1, x) = 255;
    }
  }
  return found;
}

cv::Mat1b besideJumps(const cv::Mat1f& inverse_depth, float gap, int reach) {
  cv::Mat1b beside;
  cv::dilate(jumps(inverse_depth, gap), beside,
             cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * reach + 1, 2 * reach + 1}));
  return beside;
}

cv::Mat1f distanceFromDoubt(const ObservedBracket& bracket) {
  const cv::Mat1b doubt(jumps(bracket.measured, bracket.gap(kJumpPx)) | (bracket.measured == 0));
  cv::Mat1f distance;
  cv::distanceTransform(255 - doubt, distance, cv::DIST_L2, 3);
  return distance;
}

cv::Mat3s exposed(const cv::Mat& frame, double gain, const LightCurve& curve) {
  cv::Mat1s table(1, 256);
  const auto factor = static_cast<float>(curve.gainOf(gain));
  for (int code = 0; code < 256; ++code)
    table(code) = static_cast<short>(kCodeScale * curve.code(factor * curve.light(code)) + 0.5f);
  cv::Mat3s codes;
  cv::LUT(frame, table, codes);
  return codes;
}

}  // namespace all_in_focus::core
