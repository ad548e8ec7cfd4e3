// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/pair_alignment.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr double kContrastFloor = 0.5;  // gray levels; below, contrast may be noise
constexpr double kResidualFloor = 0.2;  // gray levels; rounding leaves as much

constexpr int kMargin = 2;               // px at the border of a level which smoothing has spoilt
constexpr int kIterations = 5;           // at each level
constexpr double kSmallStep = 0.003;     // px of a level: converged
constexpr double kLargestStep = 0.03;    // px of a level: not converged
constexpr double kLargestMotion = 0.05;  // of the radius, or of the width
constexpr double kSharedEdges = 4;       // neighbouring tiles err alike: so many count as one

// Cubic B-spline at a position between the pixels first + 1 and first + 2: weights of four pixels.
struct SplineTaps {
  int first;
  std::array<float, 4> weight;
};

SplineTaps splineTaps(double position, int length) {
  const int whole = std::clamp(static_cast<int>(std::floor(position)), 1, length - 3);
  const auto f = static_cast<float>(std::clamp(position - whole, 0.0, 1.0)), g = 1 - f;
  return {whole - 1,
          {g * g * g / 6, (4 - 3 * f * f * (2 - f)) / 6, (4 - 3 * g * g * (2 - g)) / 6, f * f * f / 6}};
}

// One axis of a motion in a level: u' = center + scale (u - center) + shift.
struct Axis {
  double scale, center, shift;
  int length;  // of the picture that is read

  double operator()(int u) const { return center + scale * (u - center) + shift; }
  bool covers(int first, int last) const { return (*this)(first) >= 1 && (*this)(last) <= length - 2; }
};

// out[i] = spline of the picture at the i-th column; row: buffer of a row of the picture.
void sampleRow(const cv::Mat& image, const SplineTaps& y, const std::vector<SplineTaps>& columns,
               std::vector<float>& row, float* out) {
  const float* from[4];
  for (int k = 0; k < 4; ++k) from[k] = image.ptr<float>(y.first + k);
  const std::array<float, 4> w = y.weight;
  for (int x = 0; x < image.cols; ++x) {
    row[x] = w[0] * from[0][x] + w[1] * from[1][x] + w[2] * from[2][x] + w[3] * from[3][x];
  }
  for (size_t i = 0; i < columns.size(); ++i) {
    const float* pixel = row.data() + columns[i].first;
    const std::array<float, 4>& c = columns[i].weight;
    out[i] = c[0] * pixel[0] + c[1] * pixel[1] + c[2] * pixel[2] + c[3] * pixel[3];
  }
}

// Sums in eight lanes, which compilers turn into vectors.
template <size_t N>
float dot(const std::array<float, N>& a, const std::array<float, N>& b) {
  std::array<float, 8> lanes{};
  for (size_t i = 0; i < N; i += lanes.size()) {
    for (size_t k = 0; k < lanes.size(); ++k) lanes[k] += a[i + k] * b[i + k];
  }
  return ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]));
}

// a - factor b
template <size_t N>
void subtract(float factor, const std::array<float, N>& b, std::array<float, N>& a) {
  for (size_t i = 0; i < N; ++i) a[i] -= factor * b[i];
}

// Normalised correlation of the contrast of two frames; of two frames without any, 1.
double correlation(const cv::Mat& key, const cv::Mat& frame, const Motion& motion,
                   const cv::Point2d& center) {
  const cv::Point2d offset = center - motion.scale * center + motion.shift;
  const cv::Matx23d to_frame(motion.scale, 0, offset.x, 0, motion.scale, offset.y);
  cv::Mat aligned;
  cv::warpAffine(frame, aligned, to_frame, key.size(), cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
  const double floor = kContrastFloor * kContrastFloor * static_cast<double>(key.total());
  return (key.dot(aligned) + floor) / std::sqrt((key.dot(key) + floor) * (aligned.dot(aligned) + floor));
}

}  // namespace

void PairAlignment::setKey(const ImagePyramid& key, const cv::Point2d& center) {
  levels_.resize(key.levels());
  for (int i = 0; i < key.levels(); ++i) {
    Level& level = levels_[i];
    level.size = key.level(i).size();
    level.reduction = key.reduction(i);
    level.center = center * (1 / level.reduction);
    level.radius = 0.5 * std::hypot(level.size.width, level.size.height);
    level.grid = (level.size - cv::Size(2 * kMargin, 2 * kMargin)) / kTile;
    level.origin = (level.size - level.grid * kTile) / 2;
    level.tiles.resize(level.grid.area());
    for (int j = 0; j < level.grid.height; ++j) {
      for (int k = 0; k < level.grid.width; ++k) {
        fill(level, key.level(i), level.origin + kTile * cv::Point(k, j),
             level.tiles[j * level.grid.width + k]);
      }
    }
  }
  key.contrast().copyTo(contrast_);
}

ALL_IN_FOCUS_SIMD void PairAlignment::fill(const Level& level, const cv::Mat& image, const cv::Point& corner, Tile& tile) {
  // The spline and its derivatives at the pixels: [1 4 1] / 6, [-1 0 1] / 2, [1 -2 1].
  tile.nuisance[0].fill(1.0f / kTile);
  for (int v = 0; v < kTile; ++v) {
    const float* north = image.ptr<float>(corner.y + v - 1) + corner.x;
    const float* here = image.ptr<float>(corner.y + v) + corner.x;
    const float* south = image.ptr<float>(corner.y + v + 1) + corner.x;
    std::array<float, kTile + 2> value, slope, bend;
    for (int u = 0; u < kTile + 2; ++u) {
      value[u] = (north[u - 1] + 4 * here[u - 1] + south[u - 1]) / 6;
      slope[u] = (south[u - 1] - north[u - 1]) / 2;
      bend[u] = north[u - 1] - 2 * here[u - 1] + south[u - 1];
    }
    const auto y = static_cast<float>((corner.y + v - level.center.y) / level.radius);
    const auto x = static_cast<float>((corner.x - level.center.x) / level.radius);
    const auto x_step = static_cast<float>(1 / level.radius);
    for (int u = 0; u < kTile; ++u) {
      const int i = kTile * v + u;
      const float gx = (value[u + 2] - value[u]) / 2;
      const float gy = (slope[u] + 4 * slope[u + 1] + slope[u + 2]) / 6;
      tile.image[i] = tile.nuisance[1][i] = (value[u] + 4 * value[u + 1] + value[u + 2]) / 6;
      tile.nuisance[2][i] =
          value[u] - 2 * value[u + 1] + value[u + 2] + (bend[u] + 4 * bend[u + 1] + bend[u + 2]) / 6;
      tile.jacobian[0][i] = gx * (x + x_step * static_cast<float>(u)) + gy * y;
      tile.jacobian[1][i] = gx;
      tile.jacobian[2][i] = gy;
    }
  }
  for (int n = 1; n < 3; ++n) {
    Pixels& vector = tile.nuisance[n];
    for (int m = 0; m < n; ++m) subtract(dot(vector, tile.nuisance[m]), tile.nuisance[m], vector);
    const float norm = std::sqrt(dot(vector, vector));
    const float factor = norm > 1e-2f ? 1 / norm : 0;  // rounding is all there is in a flat tile
    for (float& value : vector) value *= factor;
  }
  for (int a = 0; a < 3; ++a) {
    for (const Pixels& nuisance : tile.nuisance) {
      subtract(dot(tile.jacobian[a], nuisance), nuisance, tile.jacobian[a]);
    }
    for (int b = 0; b <= a; ++b) {
      tile.information(a, b) = tile.information(b, a) = dot(tile.jacobian[a], tile.jacobian[b]);
    }
  }
}

PairAlignment::Estimate PairAlignment::refine(const Level& level, const cv::Mat& image,
                                              const cv::Vec3d& guess) {
  const int width = level.grid.width * kTile;
  std::vector<SplineTaps> columns(width);
  std::vector<float> row(image.cols), band(width * kTile);
  // Where the pictures say nothing the guess stays, give or take the largest motion.
  const cv::Matx33d prior = cv::Matx33d::eye() * (1 / std::pow(kLargestMotion * level.radius, 2));

  Estimate estimate{guess, cv::Matx33d::zeros(), 0};
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const double scale = 1 + estimate.motion[0] / level.radius;
    const Axis x{scale, level.center.x, estimate.motion[1], image.cols};
    const Axis y{scale, level.center.y, estimate.motion[2], image.rows};
    for (int i = 0; i < width; ++i) columns[i] = splineTaps(x(level.origin.x + i), image.cols);

    cv::Matx33d information = prior, scatter = prior;
    cv::Vec3d gradient;
    for (int j = 0; j < level.grid.height; ++j) {
      const int top = level.origin.y + j * kTile;
      if (!y.covers(top, top + kTile - 1)) continue;
      for (int v = 0; v < kTile; ++v) {
        sampleRow(image, splineTaps(y(top + v), image.rows), columns, row, band.data() + v * width);
      }
      for (int k = 0; k < level.grid.width; ++k) {
        const int left = level.origin.x + k * kTile;
        if (!x.covers(left, left + kTile - 1)) continue;
        const Tile& tile = level.tiles[j * level.grid.width + k];
        Pixels residual;
        for (int v = 0; v < kTile; ++v) {
          for (int u = 0; u < kTile; ++u) {
            residual[kTile * v + u] = band[v * width + k * kTile + u] - tile.image[kTile * v + u];
          }
        }
        double unexplained = dot(residual, residual);
        for (const Pixels& nuisance : tile.nuisance) unexplained -= std::pow(dot(residual, nuisance), 2);
        const double variance = std::max(unexplained, 0.0) / (kTile * kTile - 3);  // three nuisances
        const double weight = 1 / (variance + kResidualFloor * kResidualFloor);
        cv::Vec3d pull;
        for (int a = 0; a < 3; ++a) pull[a] = weight * dot(tile.jacobian[a], residual);
        information += weight * tile.information;
        gradient += pull;
        scatter += kSharedEdges * pull * pull.t();
      }
    }
    const cv::Matx33d inverse = information.inv(cv::DECOMP_CHOLESKY);
    const cv::Vec3d step = inverse * gradient;
    estimate.motion -= step;
    // Uncertain as far as the tiles disagree: A^-1 sum(g g^T) A^-1, the "sandwich" estimate.
    estimate.covariance = inverse * scatter * inverse;
    estimate.step = cv::norm(step);
    if (estimate.step < kSmallStep) break;
  }
  return estimate;
}

PairMeasurement PairAlignment::measure(const ImagePyramid& frame, const Motion& guess) const {
  const double radius = levels_[0].radius * levels_[0].reduction;
  const double width = levels_[0].size.width * levels_[0].reduction;
  PairMeasurement result;
  result.motion = guess;
  cv::Vec3d motion((guess.scale - 1) * radius, guess.shift.x, guess.shift.y);
  for (int i = frame.levels() - 1; i >= 0; --i) {
    const double reduction = levels_[i].reduction;
    const Estimate estimate = refine(levels_[i], frame.level(i), motion / reduction);
    const cv::Vec3d refined = estimate.motion * reduction;
    const cv::Matx33d covariance = estimate.covariance * (reduction * reduction);
    if (estimate.step > kLargestStep || std::abs(refined[0]) > kLargestMotion * radius ||
        std::hypot(refined[1], refined[2]) > kLargestMotion * width) {
      continue;
    }
    motion = refined;
    // Mostly the finest level; where all is blurred, what is fine is noise and traces of compression.
    if (!result.converged || cv::trace(covariance) < cv::trace(result.covariance)) {
      result.motion = {1 + motion[0] / radius, {motion[1], motion[2]}};
      result.covariance = covariance;
      result.converged = true;
    }
  }
  const Motion coarse{result.motion.scale, result.motion.shift * (1 / levels_.back().reduction)};
  result.correlation = correlation(contrast_, frame.contrast(), coarse, levels_.back().center);
  return result;
}

}  // namespace all_in_focus::core
