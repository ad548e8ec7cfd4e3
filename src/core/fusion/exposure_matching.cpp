// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/exposure_matching.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <stdexcept>

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

// Codes from kClipped on get so much light that their block counts as too bright.
const std::array<float, 256>& lightOfCode() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> light;
    light.fill(1e6f);
    for (int code = 0; code < kClipped; ++code) light[code] = static_cast<float>(lightOf(code));
    return light;
  }();
  return table;
}

}  // namespace

// Sorts no more than it must: finds the half that holds the median, then the half of that, and so on.
double ExposureMatching::median(std::vector<Weighted>& values) {
  const auto less = [](const Weighted& a, const Weighted& b) { return a.value < b.value; };
  const auto add = [](double sum, const Weighted& v) { return sum + v.weight; };
  double left = std::accumulate(values.begin(), values.end(), 0.0, add) / 2;  // to come before the median
  auto begin = values.begin(), end = values.end();
  while (end - begin > 1) {
    const auto middle = begin + (end - begin) / 2;
    std::nth_element(begin, middle, end, less);
    const double lower = std::accumulate(begin, middle, 0.0, add);
    if (lower >= left) {
      end = middle;
    } else {
      left -= lower;
      begin = middle;
    }
  }
  return begin == end ? 0 : begin->value;
}

// All channels at once: their sums do not wait for one another.
template <int kChannels>
void ExposureMatching::findBlock(const cv::Mat& image, const cv::Point& corner, int step, Block* blocks) {
  const std::array<float, 256>& light = lightOfCode();
  std::array<float, kChannels> sum{}, squares{};
  for (int v = 0; v < kSamples; ++v) {
    const auto* pixel = image.ptr<std::uint8_t>(corner.y + v * step) + corner.x * kChannels;
    for (int u = 0; u < kSamples; ++u, pixel += step * kChannels) {
      for (int c = 0; c < kChannels; ++c) {
        const float value = light[pixel[c]];
        sum[c] += value;
        squares[c] += value * value;
      }
    }
  }
  for (int c = 0; c < kChannels; ++c) {
    constexpr float n = kSamples * kSamples;
    Block& block = blocks[c];
    block.light = sum[c] / n;
    const bool exposed = block.light > light[kDark] && block.light < light[kBright];
    const float contrast = std::max(0.0f, n * squares[c] / (sum[c] * sum[c]) - 1);
    block.contrast = exposed && contrast < kTextured ? contrast : -1;
  }
}

void ExposureMatching::findBlocks(const cv::Mat& image, std::vector<Block>& blocks) {
  const int side = std::max(image.cols / kColumns, kSamples);
  const int columns = image.cols / side, rows = image.rows / side, channels = image.channels();
  blocks.resize(columns * rows * channels);
  auto block = blocks.begin();
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i, block += channels) {
      const cv::Point corner(i * side, j * side);
      channels == 3 ? findBlock<3>(image, corner, side / kSamples, &*block)
                    : findBlock<1>(image, corner, side / kSamples, &*block);
    }
  }
}

void ExposureMatching::setReference(const cv::Mat& reference) {
  if (reference.type() != CV_8UC1 && reference.type() != CV_8UC3) {
    throw std::invalid_argument("exposure: the reference must be CV_8UC1 or CV_8UC3");
  }
  size_ = reference.size();
  type_ = reference.type();
  findBlocks(reference, reference_);
}

double ExposureMatching::gain(const cv::Mat& frame) {
  if (frame.size() != size_ || frame.type() != type_) {
    throw std::invalid_argument("exposure: the frame must be of the reference's size and type");
  }
  findBlocks(frame, seen_);
  ratios_.clear();
  double sum = 0, squares = 0;
  for (size_t i = 0; i < seen_.size(); ++i) {
    const Block &a = reference_[i], &b = seen_[i];
    if (a.contrast < 0 || b.contrast < 0) continue;
    const auto weight = static_cast<float>(1 / (kNoise * kNoise + a.contrast + b.contrast));
    ratios_.push_back({std::log(a.light / b.light), weight});
    sum += weight;
    squares += weight * weight;
  }
  const double exposure = median(ratios_);
  if (!(std::abs(exposure) > kNoticeable)) return 1;
  for (Weighted& ratio : ratios_) ratio.value = std::abs(ratio.value - static_cast<float>(exposure));
  // Standard deviation of a median, from the median deviation, for normal errors.
  const double deviation = 1.2533 * 1.4826 * median(ratios_) * std::sqrt(squares) / sum;
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
