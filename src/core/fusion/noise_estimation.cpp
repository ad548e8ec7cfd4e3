// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/noise_estimation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

namespace all_in_focus::core {
namespace {

constexpr double kMaskNorm = 6;                     // root of the sum of squares of the mask
constexpr double kMedianOfNormal = 0.6745;          // median of |x|, x normal with deviation 1
const double kMeanOfNormal = std::sqrt(2 / CV_PI);  // mean of |x|
constexpr int kRowStep = 2;                         // every other row is enough for a median

// Mean modified Laplacian of white noise, in its standard deviations: a sum of two Laplacians of variance 6.
const double kSharpnessOfWhite = 2 * std::sqrt(6) * std::sqrt(2 / CV_PI);
// The same of noise that is correlated over the pixels of a level. The pyramid has smoothed it on the way
// there: 1.2 to 1.4 was measured where white noise was enlarged 2 to 8 times, and a little more with texture.
constexpr double kSharpnessOfCorrelated = 1.5;

// Correlated noise differs little between neighbours, so its Laplacian is larger than the response to the
// mask suggests: 1.7 to 2.5 times as large where noise was enlarged 3 to 8 times, at the level where it is
// greatest. A larger Laplacian is texture.
constexpr double kMostOfWhite = 2.5;
constexpr double kLeastOfFiner = 0.4;  // sharpness of a level / sharpness of the finer one

constexpr int kUnit = 256;             // of a gray level, as in SharpnessPyramid
constexpr int kBlock = 8;              // pixels
constexpr std::size_t kBlocks = 300;   // fewest that give a tenth percentile
constexpr double kQuiet = 0.1;         // share of the blocks
constexpr double kQuietOfMean = 0.85;  // that percentile / mean, of noise alone
constexpr int kDark = 8, kBright = 247;

// The mean of the noise, estimated from the tenth percentile of the blocks.
double quietest(std::vector<float>& blocks) {
  const auto rank = static_cast<std::ptrdiff_t>(kQuiet * static_cast<double>(blocks.size()));
  std::nth_element(blocks.begin(), blocks.begin() + rank, blocks.end());
  return blocks[rank] / kQuietOfMean;
}

// Means over every block that is neither black nor white, gray levels, of a CV_16UC1 level.
struct Blocks {
  std::vector<float> laplacian;  // modified
  std::vector<float> response;   // to the mask

  explicit Blocks(const cv::Mat& level) {
    for (int y = 1; y + kBlock < level.rows; y += kBlock) {
      for (int x = 1; x + kBlock < level.cols; x += kBlock) add(level, x, y);
    }
  }

 private:
  void add(const cv::Mat& level, int x, int y) {
    constexpr int kPixels = kBlock * kBlock * kUnit;
    int light = 0, laplacians = 0, responses = 0;
    for (int v = y; v < y + kBlock; ++v) {
      const auto* north = level.ptr<std::uint16_t>(v - 1);
      const auto* here = level.ptr<std::uint16_t>(v);
      const auto* south = level.ptr<std::uint16_t>(v + 1);
      const auto column = [&](int u) { return north[u] - 2 * here[u] + south[u]; };
      for (int u = x; u < x + kBlock; ++u) {
        light += here[u];
        laplacians += std::abs(column(u)) + std::abs(here[u - 1] - 2 * here[u] + here[u + 1]);
        responses += std::abs(column(u - 1) - 2 * column(u) + column(u + 1));
      }
    }
    if (light < kDark * kPixels || light > kBright * kPixels) return;
    laplacian.push_back(static_cast<float>(laplacians) / kPixels);
    response.push_back(static_cast<float>(responses) / kPixels);
  }
};

}  // namespace

double noiseDeviation(const cv::Mat& gray) {
  std::array<int, 8 * 255 + 1> histogram{};
  int total = 0;
  for (int v = 1; v + 1 < gray.rows; v += kRowStep) {
    const auto* north = gray.ptr<std::uint8_t>(v - 1);
    const auto* here = gray.ptr<std::uint8_t>(v);
    const auto* south = gray.ptr<std::uint8_t>(v + 1);
    const auto column = [&](int u) { return north[u] - 2 * here[u] + south[u]; };
    for (int u = 1; u + 1 < gray.cols; ++u, ++total) {
      ++histogram[std::abs(column(u - 1) - 2 * column(u) + column(u + 1))];
    }
  }
  if (total == 0) return 0;
  // The median within its bin of integer responses: the bin m holds responses from m - 0.5 to m + 0.5.
  int below = 0, median = 0;
  while (2 * (below + histogram[median]) < total) below += histogram[median++];
  const double share = (total / 2.0 - below) / histogram[median];
  const double response = median == 0 ? 0.5 * share : median - 0.5 + share;
  return response / (kMedianOfNormal * kMaskNorm);
}

NoiseSpectrum NoiseSpectrum::white(double deviation) {
  return NoiseSpectrum(std::vector<double>{kSharpnessOfWhite * deviation});
}

NoiseSpectrum NoiseSpectrum::of(const cv::Mat& gray) {
  std::vector<double> measured;
  cv::Mat level, coarser;
  gray.convertTo(level, CV_16U, kUnit);
  for (Blocks blocks(level); blocks.response.size() >= (measured.empty() ? 1 : kBlocks);
       blocks = Blocks(level)) {
    const double white = kSharpnessOfWhite * quietest(blocks.response) / (kMeanOfNormal * kMaskNorm);
    measured.push_back(measured.empty() ? white : std::min(kMostOfWhite * white, quietest(blocks.laplacian)));
    cv::pyrDown(level, coarser);
    std::swap(level, coarser);
  }
  return NoiseSpectrum(std::move(measured));
}

double NoiseSpectrum::sharpness(std::size_t level) const {
  double sharpness = 0;
  for (std::size_t l = 0; l <= level; ++l)
    sharpness = std::max(kLeastOfFiner * sharpness, l < measured_.size() ? measured_[l] : 0);
  return sharpness;
}

double NoiseSpectrum::deviation() const {
  double deviation = sharpness(0) / kSharpnessOfWhite;
  for (std::size_t l = 1; l < measured_.size(); ++l)
    deviation = std::max(deviation, sharpness(l) / kSharpnessOfCorrelated);
  return deviation;
}

NoiseSpectrum NoiseSpectrum::least(const NoiseSpectrum& a, const NoiseSpectrum& b) {
  NoiseSpectrum both;
  const std::size_t levels = std::min(a.measured_.size(), b.measured_.size());
  for (std::size_t l = 0; l < levels; ++l) both.measured_.push_back(std::min(a.measured_[l], b.measured_[l]));
  return both;
}

}  // namespace all_in_focus::core
