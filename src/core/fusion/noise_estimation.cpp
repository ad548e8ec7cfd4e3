// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "fusion/noise_estimation.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <optional>

namespace all_in_focus::core {
namespace {

constexpr double kMaskNorm = 6;                     // root of the sum of squares of the mask
const double kMeanOfNormal = std::sqrt(2 / CV_PI);  // mean of |x|

// Mean modified Laplacian of white noise, in its standard deviations: a sum of two Laplacians of variance 6.
const double kSharpnessOfWhite = 2 * std::sqrt(6) * std::sqrt(2 / CV_PI);
constexpr struct NoiseParameters {
  // Mean modified Laplacian of noise that is correlated over the pixels of a level, in its standard
  // deviations. The pyramid has smoothed it on the way there: 1.2 to 1.4 was measured where white noise was
  // enlarged 2 to 8 times, and a little more with texture.
  double sharpness_of_correlated = 1.5;
  // Correlated noise differs little between neighbours, so its Laplacian is larger than the response to the
  // mask suggests: 1.7 to 2.5 times as large where noise was enlarged 3 to 8 times, at the level where it is
  // greatest. A larger Laplacian is texture. (No limit: slope_24mm -4.5 dB where the reference is the first
  // frame and so the only one measured, else 0.)
  double most_of_white = 2.5;
  double least_of_finer = 0.4;  // sharpness of a level / sharpness of the finer one
  std::size_t blocks = 300;     // fewest that give a tenth percentile
  std::size_t plenty = 1200;    // half of which give it well
  double quiet = 0.1;           // share of the blocks
  double quiet_of_mean = 0.85;  // that percentile / mean, of noise alone
  int dark = 8, bright = 247;   // codes between which noise is not cut off
} kNoise{};

constexpr int kBlock = 8;  // pixels

// The mean of the noise, estimated from the tenth percentile of the blocks.
double quietest(std::vector<float>& blocks) {
  const auto rank = static_cast<std::ptrdiff_t>(kNoise.quiet * static_cast<double>(blocks.size()));
  std::nth_element(blocks.begin(), blocks.begin() + rank, blocks.end());
  return blocks[rank] / kNoise.quiet_of_mean;
}

// Means over every block that counts, gray levels.
struct Blocks {
  std::vector<float> laplacian;  // modified
  std::vector<float> response;   // to the mask
};

// A row of blocks, with a row more above and below.
cv::Mat1f rowOfBlocks(const cv::Mat& level, int y) {
  cv::Mat1f rows;
  level.rowRange(y - 1, y + kBlock + 1).convertTo(rows, CV_32F);
  return rows;
}

// Whether a block is neither nearly black nor nearly white; noise is cut off there.
bool isExposed(const cv::Mat1f& rows, int x) {
  float light = 0;
  for (int v = 1; v <= kBlock; ++v) light = std::accumulate(rows[v] + x, rows[v] + x + kBlock, light);
  return light >= kNoise.dark * kBlock * kBlock && light <= kNoise.bright * kBlock * kBlock;
}

void measure(const cv::Mat1f& rows, int x, Blocks& blocks) {
  float laplacians = 0, responses = 0;
  for (int v = 1; v <= kBlock; ++v) {
    const float *north = rows[v - 1], *here = rows[v], *south = rows[v + 1];
    const auto column = [&](int u) { return north[u] - 2 * here[u] + south[u]; };
    for (int u = x; u < x + kBlock; ++u) {
      laplacians += std::abs(column(u)) + std::abs(here[u - 1] - 2 * here[u] + here[u + 1]);
      responses += std::abs(column(u - 1) - 2 * column(u) + column(u + 1));
    }
  }
  blocks.laplacian.push_back(laplacians / (kBlock * kBlock));
  blocks.response.push_back(responses / (kBlock * kBlock));
}

// Blocks of a level, or of its difference to that of another frame, divided by the root of 2; of every other
// row of blocks where that leaves plenty.
Blocks blocksOf(const cv::Mat& level, const cv::Mat& other) {
  Blocks blocks;
  const int step = level.total() > kNoise.plenty * kBlock * kBlock ? 2 * kBlock : kBlock;
  for (int y = 1; y + kBlock < level.rows; y += step) {
    const cv::Mat1f rows = rowOfBlocks(level, y), of_other = other.empty() ? rows : rowOfBlocks(other, y);
    const cv::Mat1f measured = other.empty() ? rows : cv::Mat1f((rows - of_other) / std::sqrt(2.0));
    for (int x = 1; x + kBlock < level.cols; x += kBlock) {
      if (isExposed(rows, x) && isExposed(of_other, x)) measure(measured, x, blocks);
    }
  }
  return blocks;
}

// Sharpness of the noise of a level; none where too few blocks count.
std::optional<double> noiseOf(Blocks blocks, bool is_finest) {
  if (blocks.response.size() < (is_finest ? 1 : kNoise.blocks)) return std::nullopt;
  const double white = kSharpnessOfWhite * quietest(blocks.response) / (kMeanOfNormal * kMaskNorm);
  return is_finest ? white : std::min(kNoise.most_of_white * white, quietest(blocks.laplacian));
}

}  // namespace

cv::Mat nextLevel(const cv::Mat& image) {
  cv::Mat level;
  if (image.depth() == CV_32F) {
    cv::pyrDown(image, level);
    return level;
  }
  // By way of 16 bits: a whole frame takes half the memory that floats would.
  constexpr int kUnit = 128;  // of a gray level
  cv::Mat units, of_level;
  image.convertTo(units, CV_16S, kUnit);
  cv::pyrDown(units, of_level);
  of_level.convertTo(level, CV_32F, 1.0 / kUnit);
  return level;
}

NoiseSpectrum NoiseSpectrum::of(const cv::Mat& gray, std::vector<cv::Mat> others) {
  NoiseSpectrum noise;
  for (cv::Mat level = gray;; level = nextLevel(level)) {
    std::optional<double> least;
    const auto measure = [&](const cv::Mat& a, const cv::Mat& b = {}) {
      const std::optional<double> found = noiseOf(blocksOf(a, b), /*is_finest=*/noise.measured_.empty());
      if (found) least = std::min(*found, least.value_or(*found));
    };
    measure(level);
    for (cv::Mat& other : others) {
      measure(other);
      measure(level, other);
      other = nextLevel(other);
    }
    if (!least) return noise;
    noise.measured_.push_back(*least);
  }
}

double NoiseSpectrum::sharpness(std::size_t level) const {
  double sharpness = 0;
  for (std::size_t l = 0; l <= level; ++l)
    sharpness = std::max(kNoise.least_of_finer * sharpness, l < measured_.size() ? measured_[l] : 0);
  return sharpness;
}

double NoiseSpectrum::whiteDeviation() const {
  return sharpness(0) / kSharpnessOfWhite;
}

double NoiseSpectrum::deviation() const {
  double deviation = whiteDeviation();
  for (std::size_t l = 1; l < measured_.size(); ++l)
    deviation = std::max(deviation, sharpness(l) / kNoise.sharpness_of_correlated);
  return deviation;
}

}  // namespace all_in_focus::core
