// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/pair_alignment.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "util/simd.hpp"

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

ALL_IN_FOCUS_SIMD void combineAcross(const std::array<const float*, 4>& rows, const std::array<float, 4>& w,
                                     int n, float* __restrict out) {
  const float *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3];
  for (int i = 0; i < n; ++i) out[i] = w[0] * a[i] + w[1] * b[i] + w[2] * c[i] + w[3] * d[i];
}

// Every value has weights of its own: w[i], w[stride + i], ...
ALL_IN_FOCUS_SIMD void combineAlong(const float* from, const float* w, size_t stride, int n,
                                    float* __restrict out) {
  for (int i = 0; i < n; ++i) {
    out[i] = w[i] * from[i] + w[stride + i] * from[i + 1] + w[2 * stride + i] * from[i + 2] +
             w[3 * stride + i] * from[i + 3];
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

// Normalised correlation of the contrast of two frames; of two frames without any, 1. aligned: buffer.
double correlation(const cv::Mat& key, const cv::Mat& frame, const Motion& motion, const cv::Point2d& center,
                   cv::Mat& aligned) {
  const cv::Point2d offset = center - motion.scale * center + motion.shift;
  const cv::Matx23d to_frame(motion.scale, 0, offset.x, 0, motion.scale, offset.y);
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

ALL_IN_FOCUS_SIMD void PairAlignment::fill(const Level& level, const cv::Mat& image, const cv::Point& corner,
                                           Tile& tile) {
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

// Taps of the columns origin, origin + 1, ... in a level, and runs of columns with neighbouring taps.
void PairAlignment::Columns::prepare(const Axis& axis, int origin, int width) {
  runs.clear();
  weights.resize(4 * static_cast<size_t>(width));
  for (int i = 0; i < width; ++i) {
    const SplineTaps taps = splineTaps(axis(origin + i), axis.length);
    appendToRuns(runs, i, taps.first);
    for (size_t k = 0; k < 4; ++k) weights[k * width + i] = taps.weight[k];
  }
}

// out[i] = spline of the picture at the i-th column.
void PairAlignment::sampleRow(const cv::Mat& image, double y, int width, float* out) {
  const SplineTaps taps = splineTaps(y, image.rows);
  std::array<const float*, 4> rows;
  for (int k = 0; k < 4; ++k) rows[k] = image.ptr<float>(taps.first + k);
  row_.resize(image.cols);
  combineAcross(rows, taps.weight, image.cols, row_.data());
  for (const TapRun& run : columns_.runs) {
    combineAlong(row_.data() + run.begin + run.offset, columns_.weights.data() + run.begin, width,
                 run.end - run.begin, out + run.begin);
  }
}

PairAlignment::Estimate PairAlignment::refine(const Level& level, const cv::Mat& image,
                                              const cv::Vec3d& guess) {
  const int width = level.grid.width * kTile;
  band_.resize(static_cast<size_t>(width) * kTile);
  // Where the pictures say nothing the guess stays, give or take the largest motion.
  const cv::Matx33d prior = cv::Matx33d::eye() * (1 / std::pow(kLargestMotion * level.radius, 2));

  Estimate estimate{guess, cv::Matx33d::zeros(), 0};
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const double scale = 1 + estimate.motion[0] / level.radius;
    const Axis x{scale, level.center.x, estimate.motion[1], image.cols};
    const Axis y{scale, level.center.y, estimate.motion[2], image.rows};
    columns_.prepare(x, level.origin.x, width);

    cv::Matx33d information = prior, scatter = prior;
    cv::Vec3d gradient;
    for (int j = 0; j < level.grid.height; ++j) {
      const int top = level.origin.y + j * kTile;
      if (!y.covers(top, top + kTile - 1)) continue;
      for (int v = 0; v < kTile; ++v) {
        sampleRow(image, y(top + v), width, band_.data() + v * width);
      }
      for (int k = 0; k < level.grid.width; ++k) {
        const int left = level.origin.x + k * kTile;
        if (!x.covers(left, left + kTile - 1)) continue;
        const Tile& tile = level.tiles[j * level.grid.width + k];
        Pixels residual;
        for (int v = 0; v < kTile; ++v) {
          for (int u = 0; u < kTile; ++u) {
            residual[kTile * v + u] = band_[v * width + k * kTile + u] - tile.image[kTile * v + u];
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

PairMeasurement PairAlignment::measure(const ImagePyramid& frame, const Motion& guess) {
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
  result.correlation = correlation(contrast_, frame.contrast(), coarse, levels_.back().center, aligned_);
  return result;
}

}  // namespace all_in_focus::core
