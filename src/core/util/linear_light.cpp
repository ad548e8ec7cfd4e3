// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "util/linear_light.hpp"

namespace all_in_focus::core {

cv::Mat linearLight(const cv::Mat& codes, const LightCurve& curve) {
  cv::Mat1f table(1, 256);
  for (int code = 0; code < 256; ++code) table(code) = curve.light(code);
  cv::Mat light;
  cv::LUT(codes, table, light);
  return light;
}

}  // namespace all_in_focus::core
