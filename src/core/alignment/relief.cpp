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
#include "util/transparency.hpp"

namespace all_in_focus::core {

Relief reliefOf(const cv::Mat& filled, const cv::Mat& measured) {
  Relief relief;
  if (filled.empty()) return relief;
  relief.filled = filled;
  relief.measured = measured.empty() ? filled : measured;
  const double share = std::min(1.0, 160.0 / relief.measured.cols);
  cv::Mat samples, inverse, mean, deviation;
  const cv::Size size(cvRound(share * relief.measured.cols),
                      std::max(1, cvRound(share * relief.measured.rows)));
  cv::resize(relief.measured, samples, size, 0, 0, cv::INTER_NEAREST);
  cv::divide(1, samples, inverse, CV_32F);
  cv::meanStdDev(inverse, mean, deviation, samples != 0);
  relief.mean = mean.at<double>(0);
  relief.deviation = deviation.at<double>(0);
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
  inParallel(size.height, [&](int y) {
    std::transform(depth[y], depth[y] + size.width, result[y], [&](std::uint16_t z) { return relief.of(z); });
  });
  const cv::Mat known = depth != 0;
  const int count = cv::countNonZero(known);
  if (count == 0) return cv::Mat1f(size, 0.0f);
  if (count < size.area()) continueFromNearest(known, result);
  return result;
}

ParallaxView viewOf(const CameraMotion& motion, const cv::Mat1f& relief, const cv::Point2d& center) {
  const cv::Size size = relief.size();
  const cv::Matx23d m = motion.matrix(center);
  const cv::Vec3d parallax = motion.parallax;
  const double radius = 0.5 * std::hypot(size.width, size.height);
  // Displacement by relief, px.
  const auto across = [&](int x) { return parallax[0] + parallax[2] * (x - center.x) / radius; };
  const auto down = [&](int y) { return parallax[1] + parallax[2] * (y - center.y) / radius; };
  ParallaxView view{cv::Mat2f(size), cv::Mat1b(size)};
  inParallel(size.height, [&](int y) {
    for (int x = 0; x < size.width; ++x) {
      const double n = relief(y, x);
      const double u = (x - center.x) / radius, v = (y - center.y) / radius,
                   turn = motion.turn[0] * u + motion.turn[1] * v;
      view.map(y, x) = {static_cast<float>(m(0, 0) * x + m(0, 1) * y + m(0, 2) + turn * u + n * across(x)),
                        static_cast<float>(m(1, 0) * x + m(1, 1) * y + m(1, 2) + turn * v + n * down(y))};
    }
  });
  // The largest relief of the pixels that lie in each cell between four pixels of the frame; the cell before
  // the first row or column is (0, 0).
  cv::Mat1f nearest(size.height + 1, size.width + 1, -std::numeric_limits<float>::infinity());
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const cv::Point cell(cvFloor(view.map(y, x)[0]) + 1, cvFloor(view.map(y, x)[1]) + 1);
      if (cv::Rect({}, nearest.size()).contains(cell)) nearest(cell) = std::max(nearest(cell), relief(y, x));
    }
  }
  inParallel(size.height, [&](int y) {
    for (int x = 0; x < size.width; ++x) {
      const cv::Point there(cvRound(view.map(y, x)[0]), cvRound(view.map(y, x)[1]));
      view.shown(y, x) = 0;
      if (!cv::Rect({}, size).contains(there)) continue;
      const float* above = nearest[there.y] + there.x;
      const float* below = nearest[there.y + 1] + there.x;
      const double in_front = std::max({above[0], above[1], below[0], below[1]}) - relief(y, x);
      const cv::Point2d apart = in_front * cv::Point2d(across(x), down(y));
      view.shown(y, x) = apart.dot(apart) > kAlignment.hidden * kAlignment.hidden ? 0 : 255;
    }
  });
  return view;
}

}  // namespace all_in_focus::core
