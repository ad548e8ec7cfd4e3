// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "util/srgb.hpp"

#include <algorithm>
#include <cmath>

namespace all_in_focus::core {
namespace {

constexpr double kLinearLight = 0.0031308;  // up to there the curve is a straight line
constexpr double kLinearSlope = 12.92;
constexpr double kMiddleGray = 128;

// d code / d light
double srgbSlope(double light) {
  return 255 * (light <= kLinearLight ? kLinearSlope : 1.055 / 2.4 * std::pow(light, 1 / 2.4 - 1));
}

}  // namespace

double codeOf(double light) {
  return 255 * (light <= kLinearLight ? kLinearSlope * light : 1.055 * std::pow(light, 1 / 2.4) - 0.055);
}

double lightOf(double code) {
  const double v = code / 255;
  return v <= kLinearSlope * kLinearLight ? v / kLinearSlope : std::pow((v + 0.055) / 1.055, 2.4);
}

LightCurve::LightCurve(Function light_of, Function code_of, Function slope_at) : light_of_(light_of) {
  for (int code = 0; code < 256; ++code) {
    const double light = light_of(code);
    light_[code] = static_cast<float>(light);
    slope_[code] = static_cast<float>(slope_at(light));
  }
  for (int i = 0; i <= kSteps + 1; ++i)
    code_[i] = static_cast<float>(code_of(std::min(1.0, static_cast<double>(i) / kSteps)));
}

const LightCurve& LightCurve::srgb() {
  static const LightCurve curve(lightOf, codeOf, srgbSlope);
  return curve;
}

const LightCurve& LightCurve::linear() {
  static const LightCurve curve([](double code) { return code / 255; },
                                [](double light) { return 255 * light; }, [](double) { return 255.0; });
  return curve;
}

double LightCurve::gainOf(double srgb_gain) const {
  return light_of_(codeOf(srgb_gain * lightOf(kMiddleGray))) / light_of_(kMiddleGray);
}

cv::Mat linearLight(const cv::Mat& codes, const LightCurve& curve) {
  cv::Mat1f table(1, 256);
  for (int code = 0; code < 256; ++code) table(code) = curve.light(code);
  cv::Mat light;
  cv::LUT(codes, table, light);
  return light;
}

}  // namespace all_in_focus::core
