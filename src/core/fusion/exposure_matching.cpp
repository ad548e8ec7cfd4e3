// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/exposure_matching.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "util/srgb.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kColumns = 40;              // of blocks
constexpr int kSamples = 8;               // per side of a block
constexpr int kDark = 20, kBright = 230;  // codes between which a mean counts
constexpr int kClipped = 250;             // code from which light may be missing
constexpr double kNoise = 0.02;           // contrast of a block that is as flat as can be
// Squared contrast from which blur changes the mean light of a block by 4 % where a camera's tone curve is
// not sRGB's, or where it blurs codes, not light.
constexpr double kTextured = 0.15;
constexpr double kLargestGain = 2;
constexpr double kSignificance = 4;    // standard deviations
constexpr double kNoticeable = 0.002;  // a quarter of a code

// Linear light by code. Codes from kClipped on get so much light that their block counts as too bright.
const cv::Mat1f& lightOfCode() {
  static const cv::Mat1f table = [] {
    cv::Mat1f light(1, 256, 1e6f);
    for (int code = 0; code < kClipped; ++code) light(code) = static_cast<float>(lightOf(code));
    return light;
  }();
  return table;
}

struct Weighted {
  float value, weight;
};

double median(std::vector<Weighted>& values) {
  std::sort(values.begin(), values.end(),
            [](const Weighted& a, const Weighted& b) { return a.value < b.value; });
  double left = 0;  // to come before the median
  for (const Weighted& v : values) left += v.weight / 2;
  for (const Weighted& v : values) {
    left -= v.weight;
    if (left <= 0) return v.value;
  }
  return 0;
}

}  // namespace

ExposureMatching::Blocks ExposureMatching::blocksOf(const cv::Mat& image) {
  Blocks blocks;
  const cv::Size grid = image.size() / std::max(image.cols / kColumns, kSamples);
  if (grid.empty()) return blocks;
  cv::Mat samples, light, squares;
  cv::resize(image, samples, grid * kSamples, 0, 0, cv::INTER_NEAREST);
  cv::LUT(samples, lightOfCode(), light);
  cv::resize(light.mul(light), squares, grid, 0, 0, cv::INTER_AREA);
  cv::resize(light, light, grid, 0, 0, cv::INTER_AREA);
  blocks.light = light.reshape(1);
  blocks.contrast = squares.reshape(1) / blocks.light.mul(blocks.light) - 1;
  const float dark = lightOfCode()(kDark), bright = lightOfCode()(kBright);
  blocks.counts = (blocks.light > dark) & (blocks.light < bright) & (blocks.contrast < kTextured);
  return blocks;
}

void ExposureMatching::setReference(const cv::Mat& reference) {
  if (reference.type() != CV_8UC1 && reference.type() != CV_8UC3) {
    throw std::invalid_argument("exposure: the reference must be CV_8UC1 or CV_8UC3");
  }
  size_ = reference.size();
  type_ = reference.type();
  reference_ = blocksOf(reference);
}

double ExposureMatching::gain(const cv::Mat& frame) const {
  if (frame.size() != size_ || frame.type() != type_) {
    throw std::invalid_argument("exposure: the frame must be of the reference's size and type");
  }
  const Blocks seen = blocksOf(frame);
  std::vector<Weighted> ratios;
  double sum = 0, squares = 0;
  for (int i = 0; i < static_cast<int>(seen.counts.total()); ++i) {
    if (!seen.counts(i) || !reference_.counts(i)) continue;
    const float contrast = std::max(0.0f, reference_.contrast(i)) + std::max(0.0f, seen.contrast(i));
    const auto weight = static_cast<float>(1 / (kNoise * kNoise + contrast));
    ratios.push_back({std::log(reference_.light(i) / seen.light(i)), weight});
    sum += weight;
    squares += weight * weight;
  }
  const double exposure = median(ratios);
  if (!(std::abs(exposure) > kNoticeable)) return 1;
  for (Weighted& ratio : ratios) ratio.value = std::abs(ratio.value - static_cast<float>(exposure));
  // Standard deviation of a median, from the median deviation, for normal errors.
  const double deviation = 1.2533 * 1.4826 * median(ratios) * std::sqrt(squares) / sum;
  if (!(std::abs(exposure) > kSignificance * deviation)) return 1;
  return std::clamp(std::exp(exposure), 1 / kLargestGain, kLargestGain);
}

std::array<float, 256> gainLut(double gain) {
  std::array<float, 256> table;
  for (int code = 0; code < 256; ++code) {
    const double shown = gain == 1 ? code : codeOf(gain * lightOf(code));  // exactly itself
    table[code] = static_cast<float>(std::min(255.0, shown));
  }
  return table;
}

}  // namespace all_in_focus::core
