// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/exposure_matching.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "all_in_focus/codes.hpp"
#include "all_in_focus/fusion.hpp"
#include "util/median.hpp"
#include "util/srgb.hpp"

namespace all_in_focus::core {
namespace {

constexpr struct ExposureParameters {
  int columns = 40;             // of blocks
  int samples = 8;              // per side of a block
  int dark = 20, bright = 230;  // codes between which a mean counts
  int clipped = 250;            // code from which light may be missing
  // Squared contrast from which blur changes the mean light of a block by 4 % where a camera's tone curve is
  // not sRGB's, or where it blurs codes, not light.
  double textured = 0.15;
  double significance = 4;    // standard deviations
  double noticeable = 0.002;  // a quarter of a code
} kExposure{};

// Of the codes; clipped ones have so much that their block counts as too bright.
const std::array<float, 256>& lights() {
  static const auto lights = [] {
    std::array<float, 256> of_code;
    of_code.fill(1e6f);
    for (int code = 0; code < kExposure.clipped; ++code) of_code[code] = LightCurve::srgb().light(code);
    return of_code;
  }();
  return lights;
}

}  // namespace

ExposureMatching::Blocks ExposureMatching::blocksOf(const cv::Mat& gray) {
  Blocks blocks;
  const cv::Size grid = gray.size() / std::max(gray.cols / kExposure.columns, kExposure.samples);
  if (grid.empty()) return blocks;
  constexpr int n = kExposure.samples;
  const std::array<float, 256>& light_of = lights();
  std::vector<int> columns(static_cast<std::size_t>(n) * grid.width);
  for (int i = 0; i < n * grid.width; ++i) columns[i] = i * gray.cols / (n * grid.width);
  cv::Mat1f squares(grid, 0.0f);
  blocks.light = cv::Mat1f(grid, 0.0f);
  for (int i = 0; i < n * grid.height; ++i) {
    const auto* codes = gray.ptr<std::uint8_t>(i * gray.rows / (n * grid.height));
    for (int x = 0; x < grid.width; ++x) {
      float sum = 0, square = 0;
      for (int u = 0; u < n; ++u) {
        const float light = light_of[codes[columns[n * x + u]]];
        sum += light;
        square += light * light;
      }
      blocks.light(i / n, x) += sum;
      squares(i / n, x) += square;
    }
  }
  blocks.light /= n * n;
  const cv::Mat1f contrast(squares / blocks.light.mul(blocks.light) / (n * n) - 1);
  blocks.counts = (blocks.light > lightOf(kExposure.dark)) & (blocks.light < lightOf(kExposure.bright)) &
                  (contrast < kExposure.textured);
  return blocks;
}

double ExposureMatching::gain(const cv::Mat& gray) const {
  const Blocks seen = blocksOf(gray);
  std::vector<float> ratios;
  for (int i = 0; i < static_cast<int>(seen.counts.total()); ++i) {
    if (seen.counts(i) && reference_.counts(i))
      ratios.push_back(std::log(reference_.light(i) / seen.light(i)));
  }
  const double exposure = median(ratios);
  if (!(std::abs(exposure) > kExposure.noticeable)) return 1;
  for (float& ratio : ratios) ratio = std::abs(ratio - static_cast<float>(exposure));
  // Standard deviation of a median, from the median deviation, for normal errors.
  const double deviation = 1.2533 * 1.4826 * median(ratios) / std::sqrt(static_cast<double>(ratios.size()));
  if (!(std::abs(exposure) > kExposure.significance * deviation)) return 1;
  return std::clamp(std::exp(exposure), 1 / kLargestGain, kLargestGain);
}

double codeWithGain(double code, double gain) {
  return gain == 1 ? code : std::min(255.0, codeOf(gain * lightOf(code)));  // exactly itself
}

std::vector<std::uint16_t> gainLut(double gain, int depth) {
  if (gain == 1) return {};
  const double code_step = depth == CV_16U ? 1 / kDeepPerCode : 1;
  std::vector<std::uint16_t> table(depth == CV_16U ? 65536 : 256);
  for (std::size_t code = 0; code < table.size(); ++code)
    table[code] = cv::saturate_cast<std::uint16_t>(kDeepPerCode *
                                                   codeWithGain(code_step * static_cast<double>(code), gain));
  return table;
}

cv::Mat withGain(const AlignedFrame& frame) {
  cv::Mat image = frame.image.clone();
  const std::vector<std::uint16_t> lut = gainLut(frame.gain, image.depth());
  if (lut.empty()) return image;
  if (image.depth() == CV_8U) {
    cv::Mat codes;
    cv::Mat(lut).reshape(1, 1).convertTo(codes, CV_8U, 1 / kDeepPerCode);
    cv::LUT(image, codes, image);
  } else {
    image.forEach<cv::Vec3w>([&lut](cv::Vec3w& pixel, const int*) {
      for (std::uint16_t& code : pixel.val) code = lut[code];
    });
  }
  return image;
}

}  // namespace all_in_focus::core
