// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/exposure_matching.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>

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

// sRGB, code 0..255 <-> linear light 0..1.
double toLight(double code) {
  const double v = code / 255;
  return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

double toCode(double light) {
  return 255 * (light <= 0.0031308 ? 12.92 * light : 1.055 * std::pow(light, 1 / 2.4) - 0.055);
}

const std::array<float, 256>& lightOfCode() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> light;
    for (int code = 0; code < 256; ++code) light[code] = static_cast<float>(toLight(code));
    return light;
  }();
  return table;
}

struct Weighted {
  float value, weight;
};

// Sorts the values.
double median(std::vector<Weighted>& values) {
  std::sort(values.begin(), values.end(),
            [](const Weighted& a, const Weighted& b) { return a.value < b.value; });
  double total = 0, sum = 0;
  for (const Weighted& v : values) total += v.weight;
  for (const Weighted& v : values) {
    sum += v.weight;
    if (sum >= total / 2) return v.value;
  }
  return 0;
}

}  // namespace

std::vector<ExposureMatching::Block> ExposureMatching::blocks(const cv::Mat& image) {
  const std::array<float, 256>& light = lightOfCode();
  const int side = std::max(image.cols / kColumns, kSamples), step = side / kSamples;
  const int columns = image.cols / side, rows = image.rows / side, channels = image.channels();
  std::vector<Block> blocks(columns * rows * channels);
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      for (int c = 0; c < channels; ++c) {
        float sum = 0, squares = 0;
        int brightest = 0;
        for (int v = 0; v < kSamples; ++v) {
          const auto* row = image.ptr<std::uint8_t>(j * side + v * step) + i * side * channels + c;
          for (int u = 0; u < kSamples; ++u) {
            const int code = row[u * step * channels];
            sum += light[code];
            squares += light[code] * light[code];
            brightest = std::max(brightest, code);
          }
        }
        constexpr float n = kSamples * kSamples;
        Block& block = blocks[(j * columns + i) * channels + c];
        block.light = sum / n;
        const bool exposed =
            block.light > light[kDark] && block.light < light[kBright] && brightest < kClipped;
        const float contrast = std::max(0.0f, n * squares / (sum * sum) - 1);
        block.contrast = exposed && contrast < kTextured ? contrast : -1;
      }
    }
  }
  return blocks;
}

void ExposureMatching::setReference(const cv::Mat& reference) {
  if (reference.type() != CV_8UC1 && reference.type() != CV_8UC3) {
    throw std::invalid_argument("exposure: the reference must be CV_8UC1 or CV_8UC3");
  }
  size_ = reference.size();
  type_ = reference.type();
  reference_ = blocks(reference);
}

double ExposureMatching::gain(const cv::Mat& frame) const {
  if (frame.size() != size_ || frame.type() != type_) {
    throw std::invalid_argument("exposure: the frame must be of the reference's size and type");
  }
  const std::vector<Block> seen = blocks(frame);
  std::vector<Weighted> ratios;
  ratios.reserve(seen.size());
  double sum = 0, squares = 0;
  for (size_t i = 0; i < seen.size(); ++i) {
    const Block &a = reference_[i], &b = seen[i];
    if (a.contrast < 0 || b.contrast < 0) continue;
    const auto weight = static_cast<float>(1 / (kNoise * kNoise + a.contrast + b.contrast));
    ratios.push_back({std::log(a.light / b.light), weight});
    sum += weight;
    squares += weight * weight;
  }
  const double exposure = median(ratios);
  for (Weighted& ratio : ratios) ratio.value = std::abs(ratio.value - static_cast<float>(exposure));
  // Standard deviation of a median, from the median deviation, for normal errors.
  const double deviation = 1.2533 * 1.4826 * median(ratios) * std::sqrt(squares) / sum;
  if (!(std::abs(exposure) > std::max(kNoticeable, kSignificance * deviation))) return 1;
  return std::clamp(std::exp(exposure), 1 / kLargestGain, kLargestGain);
}

std::array<float, 256> gainTable(double gain) {
  std::array<float, 256> table;
  for (int code = 0; code < 256; ++code) {
    table[code] = static_cast<float>(std::min(255.0, toCode(gain * toLight(code))));
  }
  return table;
}

}  // namespace all_in_focus::core
