// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// sRGB: 8-bit codes (0..255, fractions allowed) and the linear light (0..1) that they stand for.
double lightOf(double code);
double codeOf(double light);

/// 8-bit codes and the linear light (0..1) that they stand for, from tables.
class LightCurve {
 public:
  static const LightCurve& srgb();

  /// Codes in proportion to light: of many machine-vision cameras, and of pictures that software blurred
  /// without regard to light.
  static const LightCurve& linear();

  float light(int code) const { return light_[code]; }

  /// light: 0..1 (clipped).
  float code(float light) const {
    const float place = light <= 0 ? 0 : light >= 1 ? kSteps : light * kSteps;
    const int i = static_cast<int>(place);
    return code_[i] + (place - static_cast<float>(i)) * (code_[i + 1] - code_[i]);
  }

  /// d code / d light at a code.
  float slope(float code) const { return slope_[static_cast<int>(code + 0.5f)]; }

  /// The gain of this curve's light that changes the code of middle gray as much as a gain of sRGB's light.
  double gainOf(double srgb_gain) const;

 private:
  using Function = double (*)(double);
  LightCurve(Function light_of, Function code_of, Function slope_at);

  static constexpr int kSteps = 4096;
  Function light_of_;
  std::array<float, 256> light_, slope_;
  std::array<float, kSteps + 2> code_;
};

/// Linear light (0..1) of 8-bit codes. codes: CV_8U, any channels; the result: CV_32F.
cv::Mat linearLight(const cv::Mat& codes, const LightCurve& curve);

}  // namespace all_in_focus::core
