// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/pair_alignment.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "alignment/alignment_parameters.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

// Four pixels make a cubic B-spline at a fraction of the way from the second to the third.
inline float spline(float a, float b, float c, float d, float f) {
  const float g = 1 - f;
  constexpr float kSixth = 1.0f / 6;
  return kSixth *
         (g * g * g * a + (4 - 3 * f * f * (2 - f)) * b + (4 - 3 * g * g * (2 - g)) * c + f * f * f * d);
}

using TapRows = std::array<const float*, 4>;

// Values begin .. end - 1.
ALL_IN_FOCUS_SIMD void combineAcross(const TapRows& rows, const float* fraction, int begin, int end,
                                     float* __restrict out) {
  const float *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3];
  for (int i = begin; i < end; ++i) out[i] = spline(a[i], b[i], c[i], d[i], fraction[i]);
}

ALL_IN_FOCUS_SIMD void combineAlong(const float* from, const float* fraction, int n, float* __restrict out) {
  for (int i = 0; i < n; ++i) out[i] = spline(from[i], from[i + 1], from[i + 2], from[i + 3], fraction[i]);
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

template <size_t N>
void subtractMean(std::array<float, N>& a) {
  std::array<float, N> ones;
  ones.fill(1);
  const float mean = dot(a, ones) / N;
  for (float& value : a) value -= mean;
}

// Scales to a norm of 1. Sets to 0 what is only rounding, as in a flat tile.
template <size_t N>
void normalize(std::array<float, N>& a) {
  const float norm = std::sqrt(dot(a, a));
  const float factor = norm > 1e-2f ? 1 / norm : 0;
  for (float& value : a) value *= factor;
}

// Normalised correlation of the contrast of two frames; of two frames without any, 1.
double correlation(const cv::Mat& key, const cv::Mat& frame, const SimilarityTransform& motion,
                   const cv::Point2d& center) {
  cv::Mat aligned;
  cv::warpAffine(frame, aligned, motion.matrix(center), key.size(), cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
  const double floor =
      kAlignment.contrast_floor * kAlignment.contrast_floor * static_cast<double>(key.total());
  return (key.dot(aligned) + floor) / std::sqrt((key.dot(key) + floor) * (aligned.dot(aligned) + floor));
}

}  // namespace

void PairAlignment::setRelief(const Relief& relief) {
  relief_ = relief;
  for (Level& level : levels_) level.relief.clear();
}

void PairAlignment::setKey(const ImagePyramid& key, const cv::Point2d& center) {
  levels_.resize(key.levels());
  for (int i = 0; i < key.levels(); ++i) {
    Level& level = levels_[i];
    level.size = key.level(i).size();
    level.reduction = key.reduction(i);
    level.center = center * (1 / level.reduction);
    level.radius = 0.5 * std::hypot(level.size.width, level.size.height);
    level.grid = (level.size - cv::Size(2 * kAlignment.border, 2 * kAlignment.border)) / kTile;
    level.origin = (level.size - level.grid * kTile) / 2;
    level.tiles.resize(level.grid.area());
    const bool needs_relief = relief_.isKnown() && level.relief.empty();
    if (needs_relief) level.relief.resize(level.tiles.size());
    for (int j = 0; j < level.grid.height; ++j) {
      for (int k = 0; k < level.grid.width; ++k) {
        const cv::Point corner = level.origin + kTile * cv::Point(k, j);
        const int index = j * level.grid.width + k;
        fill(key.level(i), corner, level.tiles[index]);
        if (needs_relief)
          level.relief[index] = reliefIn(relief_, cv::Rect(corner, cv::Size(kTile, kTile)), level.size);
      }
    }
  }
  contrast_ = key.contrast();
}

ALL_IN_FOCUS_SIMD void PairAlignment::fill(const cv::Mat& image, const cv::Point& corner, Tile& tile) {
  // The spline and its derivatives at the pixels: [1 4 1] / 6, [-1 0 1] / 2, [1 -2 1].
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
    for (int u = 0; u < kTile; ++u) {
      const int i = kTile * v + u;
      tile.gradient[0][i] = (value[u + 2] - value[u]) / 2;
      tile.gradient[1][i] = (slope[u] + 4 * slope[u + 1] + slope[u + 2]) / 6;
      tile.nuisance[0][i] = (value[u] + 4 * value[u + 1] + value[u + 2]) / 6;
      tile.nuisance[1][i] =
          value[u] - 2 * value[u + 1] + value[u + 2] + (bend[u] + 4 * bend[u + 1] + bend[u + 2]) / 6;
    }
  }
  auto& [gain, blur] = tile.nuisance;
  subtractMean(gain);
  normalize(gain);
  subtractMean(blur);
  subtract(dot(blur, gain), gain, blur);
  normalize(blur);
  auto& [gx, gy] = tile.gradient;
  for (Pixels* gradient : {&gx, &gy}) {
    subtractMean(*gradient);
    for (const Pixels& nuisance : tile.nuisance) subtract(dot(*gradient, nuisance), nuisance, *gradient);
  }
  tile.information = {dot(gx, gx), dot(gx, gy), dot(gx, gy), dot(gy, gy)};
}

PairAlignment::Shears::Shears(const Motion& motion, const Level& level, const cv::Size& size)
    : picture(size) {
  const double scale = 1 + motion[0] / level.radius, angle = motion[1] / level.radius;
  const double cosine = std::cos(angle), sine = std::sin(angle);
  const cv::Point2d c = level.center, d(motion[2], motion[3]);
  u_x = scale * cosine;
  u_y = -scale * sine;
  u0 = c.x + d.x - u_x * c.x - u_y * c.y;
  v_u = sine / cosine;
  v_y = scale / cosine;
  v0 = c.y + d.y - v_u * (c.x + d.x) - v_y * c.y;
}

PairAlignment::Shears PairAlignment::Shears::movedBy(double x, double y) const {
  Shears moved = *this;
  moved.u0 += x;
  moved.v0 += y - v_u * x;
  return moved;
}

bool PairAlignment::Shears::cover(const cv::Rect& tile) const {
  for (const int x : {tile.x, tile.br().x - 1}) {
    for (const int y : {tile.y, tile.br().y - 1}) {
      const double u = u0 + u_x * x + u_y * y, v = v0 + v_u * u + v_y * y;
      if (u < 1 || u > picture.width - 2 || v < 1 || v > picture.height - 2) return false;
    }
  }
  return true;
}

// Taps at begin, begin + step, ... of pixels 0..length-1; length >= 4. Floats are right to 1e-4 px in levels
// of this size. NaN gives the first taps.
ALL_IN_FOCUS_SIMD void PairAlignment::Taps::prepare(double begin, double step, int count, int length) {
  first.resize(count);
  fraction.resize(count);
  const auto start = static_cast<float>(begin), by = static_cast<float>(step),
             last = static_cast<float>(length - 2);
  for (int i = 0; i < count; ++i) {
    const float inside = std::min(std::max(1.0f, start + by * static_cast<float>(i)), last);
    const int whole = std::min(static_cast<int>(inside), length - 3);
    first[i] = whole - 1;
    fraction[i] = inside - static_cast<float>(whole);
  }
}

// out[i] = spline of the picture where pixel at + (i, 0) lies in it.
void PairAlignment::sampleRow(const cv::Mat& image, const Shears& shears, const cv::Point& at, int width,
                              float* out) {
  if (width == 0) return;  // the level is narrower than a tile
  along_.prepare(shears.u0 + shears.u_y * at.y + shears.u_x * at.x, shears.u_x, width, image.cols);
  const auto [begin, last] = std::minmax(along_.first.front(), along_.first.back());
  const int count = last + 4 - begin;  // columns
  across_.prepare(shears.v0 + shears.v_y * at.y + shears.v_u * begin, shears.v_u, count, image.rows);
  row_.resize(count);
  for (int u = 0, end = 0; u < count; u = end) {
    // Rows rise, or fall, all along it: if the last one is the same, so are all between.
    end = across_.first.back() == across_.first[u] ? count : u + 1;
    while (end < count && across_.first[end] == across_.first[u]) ++end;
    TapRows rows;
    for (int k = 0; k < 4; ++k) rows[k] = image.ptr<float>(across_.first[u] + k) + begin;
    combineAcross(rows, across_.fraction.data(), u, end, row_.data());
  }
  for (int i = 0, end = 0; i < width; i = end) {
    for (end = i + 1; end < width && along_.first[end] - end == along_.first[i] - i;) ++end;
    combineAlong(row_.data() + along_.first[i] - begin, along_.fraction.data() + i, end - i, out + i);
  }
}

// The turn, with the part that the shift tells.
cv::Vec2d PairAlignment::turnOf(const Motion& motion) const {
  const double known = freedom_.turn_per_shift;
  return {motion[4] + known * (motion[2] - shift_of_parallax_ * motion[6]),
          motion[5] + known * (motion[3] - shift_of_parallax_ * motion[7])};
}

// One Gauss-Newton step of N numbers of the motion, by the pulls of the tiles: the first four, and of the
// others turn (6), parallax (7) or both (9). Returns its length.
template <int N>
inline __attribute__((always_inline)) double PairAlignment::step(const Level& level,
                                                                 Estimate& estimate) const {
  using Numbers = cv::Vec<double, N>;
  using Square = cv::Matx<double, N, N>;
  const auto number = [](int i) { return N == 7 && i >= 4 ? i + 2 : i; };
  // The guess counts with the largest motion as its standard deviation: it stays where there is no texture.
  const Square prior = Square::eye() * (1 / std::pow(kAlignment.largest_motion * level.radius, 2));
  Square information = prior, scatter;
  Numbers gradient;
  double texture = 0, squared_texture = 0;
  for (const Pull& tile : pulls_) {
    if (N > 6 && std::isnan(tile.relief)) continue;
    // Derivative of the tile's shift by the numbers of the motion.
    const double x = tile.x, y = tile.y, n = tile.relief, known = freedom_.turn_per_shift;
    const cv::Vec2d by_x(x * x, x * y), by_y(x * y, y * y);  // by a turn
    const std::array<cv::Vec2d, 9> by = {cv::Vec2d(x, y),
                                         cv::Vec2d(-y, x),
                                         cv::Vec2d(1, 0) + known * by_x,
                                         cv::Vec2d(0, 1) + known * by_y,
                                         by_x,
                                         by_y,
                                         cv::Vec2d(n, 0) - known * shift_of_parallax_ * by_x,
                                         cv::Vec2d(0, n) - known * shift_of_parallax_ * by_y,
                                         cv::Vec2d(n * x, n * y)};
    cv::Matx<double, 2, N> shift;
    for (int i = 0; i < N; ++i) {
      shift(0, i) = by[number(i)][0];
      shift(1, i) = by[number(i)][1];
    }
    const Numbers pull = shift.t() * (tile.weight * tile.pull);
    const cv::Matx<double, 2, N> weighed = tile.weight * tile.information * shift;
    for (int i = 0; i < N; ++i) {
      for (int k = 0; k < N; ++k) {
        information(i, k) += shift(0, i) * weighed(0, k) + shift(1, i) * weighed(1, k);
        scatter(i, k) += pull[i] * pull[k];
      }
    }
    gradient += pull;
    const double of_tile = tile.weight * cv::trace(tile.information);
    texture += of_tile;
    squared_texture += of_tile * of_tile;
  }
  const Square inverse = information.inv(cv::DECOMP_CHOLESKY);
  const Numbers step = inverse * gradient;
  // Uncertain as far as the tiles disagree: A^-1 sum(g g^T) A^-1, the "sandwich" estimate.
  const Square covariance = inverse * (prior + kAlignment.shared_edges * scatter) * inverse;
  for (int i = 0; i < N; ++i) {
    estimate.motion[number(i)] -= step[i];
    for (int k = 0; k < N; ++k) estimate.covariance(number(i), number(k)) = covariance(i, k);
  }
  estimate.tiles = squared_texture > 0 ? texture * texture / squared_texture : 0;
  return cv::norm(step);
}

ALL_IN_FOCUS_SIMD PairAlignment::Estimate PairAlignment::refine(const Level& level, const cv::Mat& image,
                                                                const Motion& guess) {
  const int width = level.grid.width * kTile;
  band_.resize(static_cast<size_t>(width) * kTile);
  const double pitch = 1 / level.radius;
  constexpr double kMiddle = (kTile - 1) / 2.0;   // of a tile, px from its first pixel
  constexpr double kFreedom = kTile * kTile - 3;  // pixels less nuisances

  const bool by_tiles = !freedom_.isNone();  // each moves in its own way
  Estimate estimate{guess, Covariance::zeros(), 0, 0};
  for (int iteration = 0; iteration < kAlignment.iterations; ++iteration) {
    const Motion& motion = estimate.motion;
    const Shears shears(motion, level, image.size());
    const cv::Vec2d turn = turnOf(motion);
    pulls_.clear();
    for (int j = 0; j < level.grid.height; ++j) {
      const int top = level.origin.y + j * kTile;
      for (int v = 0; !by_tiles && v < kTile; ++v) {
        sampleRow(image, shears, {level.origin.x, top + v}, width, band_.data() + v * width);
      }
      const double y = (top + kMiddle - level.center.y) * pitch;
      const bool all_covered = !by_tiles && shears.cover({level.origin.x, top, width, kTile});
      for (int k = 0; k < level.grid.width; ++k) {
        const int left = level.origin.x + k * kTile, index = j * level.grid.width + k;
        const double x = (left + kMiddle - level.center.x) * pitch;
        const double relief = level.relief.empty() ? std::nan("") : level.relief[index];
        const Tile& tile = level.tiles[index];
        Pixels residual;
        if (by_tiles) {
          if (freedom_.parallax && std::isnan(relief)) continue;
          const double n = freedom_.parallax ? relief : 0, turned = turn[0] * x + turn[1] * y;
          const Shears moved = shears.movedBy(turned * x + n * (motion[6] + x * motion[8]),
                                              turned * y + n * (motion[7] + y * motion[8]));
          if (!moved.cover({left, top, kTile, kTile})) continue;
          for (int v = 0; v < kTile; ++v)
            sampleRow(image, moved, {left, top + v}, kTile, residual.data() + v * kTile);
        } else {
          if (!all_covered && !shears.cover({left, top, kTile, kTile})) continue;
          for (int v = 0; v < kTile; ++v) {
            for (int u = 0; u < kTile; ++u) {
              residual[kTile * v + u] = band_[v * width + k * kTile + u];
            }
          }
        }
        subtractMean(residual);
        double unexplained = dot(residual, residual);
        for (const Pixels& nuisance : tile.nuisance) unexplained -= std::pow(dot(residual, nuisance), 2);
        // One over the variance of a pixel.
        const double weight = kFreedom / (std::max(unexplained, 0.0) +
                                          kFreedom * kAlignment.residual_floor * kAlignment.residual_floor);
        const cv::Vec2d pull(dot(tile.gradient[0], residual), dot(tile.gradient[1], residual));
        pulls_.push_back({x, y, relief, weight, tile.information, pull});
      }
    }
    Estimate more = estimate;
    if (freedom_.parallax) {
      estimate.step = freedom_.turn ? step<9>(level, estimate) : step<7>(level, estimate);
    } else {
      estimate.step = freedom_.turn ? step<6>(level, estimate) : step<4>(level, estimate);
    }
    if (estimate.step >= kAlignment.small_step && iteration + 1 < kAlignment.iterations) continue;
    if (!by_tiles && !level.relief.empty()) {
      step<9>(level, more);
      for (int i = 6; i < 9; ++i) {
        estimate.motion[i] = more.motion[i];
        for (int k = 6; k < 9; ++k) estimate.covariance(i, k) = more.covariance(i, k);
      }
    }
    break;
  }
  return estimate;
}

// What the tiles tell of their shifts where the last step ended.
CellShifts PairAlignment::shifts(const Level& level) const {
  CellShifts result;
  const double squared = level.reduction * level.reduction;
  const double variance = std::pow(kAlignment.model_error * level.radius * level.reduction, 2);
  for (const Pull& tile : pulls_) {
    result.add((level.center.x + tile.x * level.radius) / level.size.width,
               (level.center.y + tile.y * level.radius) / level.size.height,
               tile.information * (tile.weight / squared), tile.pull * (tile.weight / level.reduction),
               variance);
  }
  return result;
}

PairMeasurement PairAlignment::measure(const ImagePyramid& frame, const CameraMotion& guess,
                                       const Freedom& freedom) {
  freedom_ = freedom;
  shift_of_parallax_ = freedom.parallax ? relief_.mean / relief_.deviation : 0;
  const bool parallax = freedom.parallax;
  const double radius = levels_[0].radius * levels_[0].reduction;
  const double width = levels_[0].size.width * levels_[0].reduction;
  PairMeasurement result;
  result.motion = guess;
  result.parallax = guess.parallax;
  Motion motion((guess.scale - 1) * radius, guess.angle * radius, guess.shift.x, guess.shift.y,
                freedom.turn ? guess.turn[0] : 0, freedom.turn ? guess.turn[1] : 0, guess.parallax[0],
                guess.parallax[1], guess.parallax[2]);
  const std::size_t numbers = 4 + (freedom.turn ? 2 : 0) + (parallax ? 3 : 0);
  const double most = (parallax ? kAlignment.farther_by_parallax : 1) * kAlignment.largest_motion;
  double least = 0;
  for (int i = frame.levels() - 1; i >= 0; --i) {
    const double reduction = levels_[i].reduction;
    const Estimate estimate = refine(levels_[i], frame.level(i), motion * (1 / reduction));
    const Motion refined = estimate.motion * reduction;
    const Covariance covariance = estimate.covariance * (reduction * reduction);
    const cv::Matx44d of_similarity = covariance.get_minor<4, 4>(0, 0);
    const cv::Vec2d of_turn = turnOf(refined);
    const cv::Vec3d of_parallax(refined[6], refined[7], refined[8]);
    // A tile gives two equations. There must be two for each number: three tiles fit any parallax.
    const bool converged = pulls_.size() >= numbers && estimate.step <= kAlignment.largest_step &&
                           std::hypot(refined[0], refined[1]) <= most * radius &&
                           std::hypot(refined[2], refined[3]) <= most * width &&
                           cv::norm(of_turn) <= most * width &&
                           (!parallax || cv::norm(of_parallax) <= most * width);
    if (!converged) continue;  // NaN is not
    motion = refined;
    if (!parallax) motion[6] = motion[7] = motion[8] = 0;
    if (!relief_.isKnown() && levels_[i].size.area() <= kAlignment.shift_level)
      result.shifts = shifts(levels_[i]);
    // The most certain level counts: mostly the finest, but in blurred pictures that has only noise.
    const double variance = parallax ? cv::trace(covariance) : cv::trace(of_similarity);
    if (!result.converged || variance < least) {
      result.motion = {1 + motion[0] / radius, {motion[2], motion[3]}, motion[1] / radius};
      result.covariance = of_similarity;
      result.turn = of_turn;
      result.turn_covariance = covariance.get_minor<2, 2>(4, 4);
      result.parallax = of_parallax;
      result.parallax_covariance = covariance.get_minor<3, 3>(6, 6);
      result.tiles = estimate.tiles;
      result.converged = true;
      least = variance;
    }
  }
  SimilarityTransform coarse = result.motion;
  coarse.shift *= 1 / levels_.back().reduction;
  result.correlation = correlation(contrast_, frame.contrast(), coarse, levels_.back().center);
  return result;
}

}  // namespace all_in_focus::core
