// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/relief.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "alignment/alignment_parameters.hpp"
#include "util/row_strips.hpp"
#include "util/simd.hpp"
#include "util/transparency.hpp"

namespace all_in_focus::core {

Relief reliefOf(const cv::Mat& filled, const cv::Mat& measured) {
  Relief relief;
  if (filled.empty()) return relief;
  relief.filled = filled;
  relief.measured = measured.empty() ? filled : measured;
  const int step = std::max(1, relief.measured.cols / 160);
  double count = 0, sum = 0, squares = 0;
  for (int y = step / 2; y < relief.measured.rows; y += step) {
    for (int x = step / 2; x < relief.measured.cols; x += step) {
      const std::uint16_t z = relief.measured(y, x);
      if (z == 0) continue;
      const double inverse = 1.0 / z;
      count += 1;
      sum += inverse;
      squares += inverse * inverse;
    }
  }
  if (count == 0) return relief;
  relief.mean = sum / count;
  relief.deviation = std::sqrt(std::max(squares / count - relief.mean * relief.mean, 0.0));
  if (relief.deviation < kAlignment.flat * relief.mean) relief.deviation = 0;
  return relief;
}

float reliefIn(const Relief& relief, const cv::Rect2d& area, const cv::Size& size) {
  const cv::Mat1w& depth = relief.measured;
  const double x_scale = static_cast<double>(depth.cols) / size.width,
               y_scale = static_cast<double>(depth.rows) / size.height;
  int nearest = std::numeric_limits<int>::max(), farthest = 0, count = 0;
  float sum = 0;
  for (int j = 0; j < kAlignment.samples; ++j) {
    const int y = static_cast<int>((area.y + (j + 0.5) / kAlignment.samples * area.height) * y_scale);
    for (int i = 0; i < kAlignment.samples; ++i) {
      const int x = static_cast<int>((area.x + (i + 0.5) / kAlignment.samples * area.width) * x_scale);
      const std::uint16_t z = depth(std::min(y, depth.rows - 1), std::min(x, depth.cols - 1));
      if (z == 0) continue;
      nearest = std::min<int>(nearest, z);
      farthest = std::max<int>(farthest, z);
      sum += 1.0f / static_cast<float>(z);
      ++count;
    }
  }
  const bool is_smooth = count >= kAlignment.least_measured * kAlignment.samples * kAlignment.samples &&
                         (1.0 / nearest - 1.0 / farthest) < kAlignment.smooth * relief.deviation;
  return is_smooth ? static_cast<float>((sum / static_cast<float>(count) - relief.mean) / relief.deviation)
                   : std::numeric_limits<float>::quiet_NaN();
}

CameraPose poseOf(const CameraMotion& motion, const Relief& relief, double focal_px, const cv::Size& size) {
  const double radius = 0.5 * std::hypot(size.width, size.height);
  const cv::Vec3d place(-motion.parallax[0] / (focal_px * relief.deviation),
                        -motion.parallax[1] / (focal_px * relief.deviation),
                        motion.parallax[2] / (radius * relief.deviation));
  // The shift is that of the mean inverse depth; what the translation leaves of it is a rotation.
  return {place,
          {motion.shift.y / focal_px + place[1] * relief.mean,
           -motion.shift.x / focal_px - place[0] * relief.mean, -motion.angle}};
}

cv::Mat1f reliefImage(const Relief& relief, const cv::Size& size) {
  cv::Mat1w depth;
  cv::medianBlur(relief.filled, depth, kAlignment.speck);
  cv::resize(depth, depth, size, 0, 0, cv::INTER_NEAREST);
  cv::Mat1f result(size);
  forEachRow(size.height, [&](int y) {
    std::transform(depth[y], depth[y] + size.width, result[y], [&](std::uint16_t z) { return relief.of(z); });
  });
  const cv::Mat known = depth != 0;
  const int count = cv::countNonZero(known);
  if (count == 0) return cv::Mat1f(size, 0.0f);
  if (count < size.area()) continueFromNearest(known, result);
  return result;
}

namespace {

// A row of the reference in the frame of a camera that has moved: where its first pixel lies there and how
// far apart they lie, without relief and by relief.
struct MovedRow {
  cv::Point2d first, step, per_relief;
  double per_relief_step;  // to the right; none down
};

MovedRow rowOf(const CameraMotion& motion, int y, const cv::Point2d& center, const cv::Size& size) {
  const cv::Matx23d m = motion.matrix(center);
  const cv::Point2d per_relief = motion.perRelief(cv::Point2d(0, y), center, size);
  return {{m(0, 1) * y + m(0, 2), m(1, 1) * y + m(1, 2)},
          {m(0, 0), m(1, 0)},
          per_relief,
          motion.perRelief(cv::Point2d(1, y), center, size).x - per_relief.x};
}

// Returns the farthest that one of n pixels lies above or below its own row y.
ALL_IN_FOCUS_SIMD double mapRow(const MovedRow& row, int y, const float* relief, int n, cv::Vec2f* to) {
  double farthest = 0;
  for (int x = 0; x < n; ++x) {
    const double there = row.first.y + row.step.y * x + relief[x] * row.per_relief.y;
    to[x][0] = static_cast<float>(row.first.x + row.step.x * x +
                                  relief[x] * (row.per_relief.x + row.per_relief_step * x));
    to[x][1] = static_cast<float>(there);
    farthest = std::max(farthest, std::abs(there - y));
  }
  return farthest;
}

// The largest relief of the pixels that lie in each cell between four pixels of the frame; the cell before
// the first row or column is (0, 0). reach: how far a pixel lies above or below its row at most.
cv::Mat1f nearestInCells(const cv::Mat2f& map, const cv::Mat1f& relief, int reach) {
  cv::Mat1f nearest(map.rows + 1, map.cols + 1, -std::numeric_limits<float>::infinity());
  forEachBlock({0, nearest.rows}, [&](const cv::Range& rows) {
    // One row more on each side, for the rounding of the map.
    const int from = std::max(0, rows.start - 2 - reach), to = std::min(map.rows, rows.end + 1 + reach);
    for (int y = from; y < to; ++y) {
      for (int x = 0; x < map.cols; ++x) {
        const int column = cvFloor(map(y, x)[0]) + 1, row = cvFloor(map(y, x)[1]) + 1;
        if (row < rows.start || row >= rows.end || column < 0 || column >= nearest.cols) continue;
        nearest(row, column) = std::max(nearest(row, column), relief(y, x));
      }
    }
  });
  return nearest;
}

}  // namespace

ParallaxView viewOf(const CameraMotion& motion, const cv::Mat1f& relief, const cv::Point2d& center) {
  const cv::Size size = relief.size();
  ParallaxView view{cv::Mat2f(size), cv::Mat1b(size)};
  std::vector<double> farthest(size.height);
  forEachRow(size.height, [&](int y) {
    farthest[y] = mapRow(rowOf(motion, y, center, size), y, relief[y], size.width, view.map[y]);
  });
  const int reach = cvCeil(*std::max_element(farthest.begin(), farthest.end()));
  const cv::Mat1f nearest = nearestInCells(view.map, relief, reach);
  forEachRow(size.height, [&](int y) {
    const MovedRow row = rowOf(motion, y, center, size);
    for (int x = 0; x < size.width; ++x) {
      const cv::Point there(cvRound(view.map(y, x)[0]), cvRound(view.map(y, x)[1]));
      view.shown(y, x) = 0;
      if (!cv::Rect({}, size).contains(there)) continue;
      const float* above = nearest[there.y] + there.x;
      const float* below = nearest[there.y + 1] + there.x;
      const double in_front = std::max({above[0], above[1], below[0], below[1]}) - relief(y, x);
      const double px = std::hypot(row.per_relief.x + row.per_relief_step * x, row.per_relief.y);
      view.shown(y, x) = in_front * px > kAlignment.hidden ? 0 : 255;
    }
  });
  return view;
}

}  // namespace all_in_focus::core
