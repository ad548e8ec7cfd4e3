// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/noise_estimation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <numeric>
#include <optional>

#include "util/image_rows.hpp"

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

constexpr int kBlock = 8;              // pixels
constexpr std::size_t kBlocks = 300;   // fewest that give a tenth percentile
constexpr std::size_t kPlenty = 1200;  // half of which give it well
constexpr double kQuiet = 0.1;         // share of the blocks
constexpr double kQuietOfMean = 0.85;  // that percentile / mean, of noise alone
constexpr int kDark = 8, kBright = 247;

// The mean of the noise, estimated from the tenth percentile of the blocks.
double quietest(std::vector<float>& blocks) {
  const auto rank = static_cast<std::ptrdiff_t>(kQuiet * static_cast<double>(blocks.size()));
  std::nth_element(blocks.begin(), blocks.begin() + rank, blocks.end());
  return blocks[rank] / kQuietOfMean;
}

// visit(x, y) for the first pixel of every block; of every other row of blocks where that leaves plenty.
template <typename Visit>
void forEachBlock(const cv::Mat& level, const Visit& visit) {
  const int step = level.total() > kPlenty * kBlock * kBlock ? 2 * kBlock : kBlock;
  for (int y = 1; y + kBlock < level.rows; y += step) {
    for (int x = 1; x + kBlock < level.cols; x += kBlock) visit(x, y);
  }
}

int unitOf(const cv::Mat& level) {
  return level.depth() == CV_8U ? 1 : kGrayUnit;
}

// By block: whether it is neither nearly black nor nearly white; noise is cut off there.
template <typename Pixel>
std::vector<bool> exposedBlocks(const cv::Mat& level) {
  const int unit = kBlock * kBlock * unitOf(level);
  std::vector<bool> exposed;
  forEachBlock(level, [&](int x, int y) {
    int light = 0;
    for (int v = y; v < y + kBlock; ++v) {
      const Pixel* row = level.ptr<Pixel>(v) + x;
      light = std::accumulate(row, row + kBlock, light);
    }
    exposed.push_back(light >= kDark * unit && light <= kBright * unit);
  });
  return exposed;
}

std::vector<bool> exposedBlocks(const cv::Mat& level) {
  return level.depth() == CV_8U ? exposedBlocks<std::uint8_t>(level) : exposedBlocks<std::uint16_t>(level);
}

// Means over every block that counts, gray levels.
struct Blocks {
  std::vector<float> laplacian;  // modified
  std::vector<float> response;   // to the mask

  // unit: of a gray level.
  template <typename Pixel>
  void measure(const cv::Mat& level, const std::vector<bool>& counts, double unit) {
    const auto pixels = static_cast<float>(kBlock * kBlock * unit);
    auto counted = counts.begin();
    forEachBlock(level, [&](int x, int y) {
      if (!*counted++) return;
      int laplacians = 0, responses = 0;
      for (int v = y; v < y + kBlock; ++v) {
        const auto* north = level.ptr<Pixel>(v - 1);
        const auto* here = level.ptr<Pixel>(v);
        const auto* south = level.ptr<Pixel>(v + 1);
        const auto column = [&](int u) { return north[u] - 2 * here[u] + south[u]; };
        for (int u = x; u < x + kBlock; ++u) {
          laplacians += std::abs(column(u)) + std::abs(here[u - 1] - 2 * here[u] + here[u + 1]);
          responses += std::abs(column(u - 1) - 2 * column(u) + column(u + 1));
        }
      }
      laplacian.push_back(static_cast<float>(laplacians) / pixels);
      response.push_back(static_cast<float>(responses) / pixels);
    });
  }
};

// Sharpness of the noise of a level; none where too few blocks count.
std::optional<double> noiseOf(Blocks blocks, bool is_finest) {
  if (blocks.response.size() < (is_finest ? 1 : kBlocks)) return std::nullopt;
  const double white = kSharpnessOfWhite * quietest(blocks.response) / (kMeanOfNormal * kMaskNorm);
  return is_finest ? white : std::min(kMostOfWhite * white, quietest(blocks.laplacian));
}

std::optional<double> noiseOf(const cv::Mat& level, const std::vector<bool>& counts) {
  Blocks blocks;
  const bool is_finest = level.depth() == CV_8U;
  if (is_finest) {
    blocks.measure<std::uint8_t>(level, counts, 1);
  } else {
    blocks.measure<std::uint16_t>(level, counts, kGrayUnit);
  }
  return noiseOf(std::move(blocks), is_finest);
}

// Of the difference of two frames, divided by the root of 2.
std::optional<double> noiseOfDifference(const cv::Mat& a, const cv::Mat& b, const std::vector<bool>& counts) {
  constexpr int kUnit = kGrayUnit / 2;  // 16 bits hold 255 of them, and a sign
  const double factor = static_cast<double>(kUnit) / unitOf(a);
  cv::Mat difference;
  cv::addWeighted(a, factor, b, -factor, 0, difference, CV_16S);
  Blocks blocks;
  blocks.measure<std::int16_t>(difference, counts, std::sqrt(2.0) * kUnit);
  return noiseOf(std::move(blocks), a.depth() == CV_8U);
}

cv::Mat coarser(const cv::Mat& level) {
  cv::Mat next;
  downsample(level, next);
  return next;
}

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

NoiseSpectrum NoiseSpectrum::of(const cv::Mat& gray, std::vector<cv::Mat> others) {
  const auto is_copy = [&](const cv::Mat& other) { return cv::norm(gray, other, cv::NORM_INF) == 0; };
  others.erase(std::remove_if(others.begin(), others.end(), is_copy), others.end());
  NoiseSpectrum noise;
  for (cv::Mat level = gray;; level = coarser(level)) {
    std::optional<double> least;
    const auto lower = [&](const std::optional<double>& found) {
      if (found) least = std::min(*found, least.value_or(*found));
    };
    const std::vector<bool> exposed = exposedBlocks(level);
    lower(noiseOf(level, exposed));
    for (const cv::Mat& other : others) {
      std::vector<bool> in_both = exposedBlocks(other);
      lower(noiseOf(other, in_both));
      std::transform(exposed.begin(), exposed.end(), in_both.begin(), in_both.begin(), std::logical_and<>());
      lower(noiseOfDifference(level, other, in_both));
    }
    if (!least) return noise;
    noise.measured_.push_back(*least);
    std::transform(others.begin(), others.end(), others.begin(), coarser);
  }
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

}  // namespace all_in_focus::core
