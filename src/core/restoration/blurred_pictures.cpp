// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "restoration/blurred_pictures.hpp"

#include <algorithm>

#include "restoration/disc_blur.hpp"
#include "restoration/observed_bracket.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {
namespace {

constexpr float kFineStep = 0.25f, kCoarseStep = 0.5f;  // px
constexpr int kFineSteps = 16;                          // then coarse: wide discs differ less
constexpr float kFineEnd = kFineSteps * kFineStep;

float radiusOf(int index) {
  return index <= kFineSteps ? kFineStep * index : kFineEnd + kCoarseStep * (index - kFineSteps);
}

}  // namespace

BlurredPictures::BlurredPictures(const cv::Mat3f& light, double largest) {
  const LightCurve& curve = LightCurve::get();
  cv::Mat blurred;
  for (int i = 0;; ++i) {
    const float radius = radiusOf(i);
    if (radius > DiscKernels::kLargestPx || (i > 0 && radius > largest + kCoarseStep / 2)) break;
    blurByDisc(light, radius, blurred);
    cv::Mat3s codes(light.size());
    cv::parallel_for_({0, light.rows}, [&](const cv::Range& rows) {
      for (int y = rows.start; y < rows.end; ++y) {
        const float* from = blurred.ptr<float>(y);
        short* to = codes.ptr<short>(y);
        for (int k = 0; k < 3 * light.cols; ++k)
          to[k] = static_cast<short>(kCodeScale * curve.code(from[k]) + 0.5f);
      }
    });
    codes_.push_back(codes);
  }
}

int BlurredPictures::index(float radius) const {
  const float place =
      radius <= kFineEnd ? radius / kFineStep : kFineSteps + (radius - kFineEnd) / kCoarseStep;
  return std::min(static_cast<int>(place + 0.5f), count() - 1);
}

}  // namespace all_in_focus::core
