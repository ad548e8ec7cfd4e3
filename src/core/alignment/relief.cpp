// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/relief.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "alignment/alignment_parameters.hpp"

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
  if (cv::countNonZero(depth) == 0) return cv::Mat1f(size, 0.0f);
  cv::Mat1f distance;
  cv::Mat1i cell;  // of the nearest pixel with depth; each such pixel has one
  cv::distanceTransform(depth == 0, distance, cell, cv::DIST_L2, cv::DIST_MASK_5, cv::DIST_LABEL_PIXEL);
  std::vector<float> of_cell(depth.total() + 1);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      if (depth(y, x) != 0) of_cell[cell(y, x)] = relief.of(depth(y, x));
    }
  }
  cv::Mat1f result(size);
  std::transform(cell.begin(), cell.end(), result.begin(), [&](int i) { return of_cell[i]; });
  return result;
}

ParallaxView viewOf(const CameraMotion& motion, const cv::Mat1f& relief, const cv::Point2d& center) {
  const cv::Size size = relief.size();
  const cv::Rect picture({}, size);
  const cv::Matx23d similarity = motion.matrix(center);
  ParallaxView view{cv::Mat2f(size), cv::Mat1b(size, 255)};
  cv::Mat1f nearest(size, -std::numeric_limits<float>::infinity());  // relief of what lies there in the frame
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const cv::Vec2d p = similarity * cv::Vec3d(x, y, 1);
      const cv::Point2d there =
          cv::Point2d(p[0], p[1]) + relief(y, x) * motion.perRelief(cv::Point2d(x, y), center, size);
      view.map(y, x) = cv::Vec2f(static_cast<float>(there.x), static_cast<float>(there.y));
      const cv::Point corner(cvFloor(there.x), cvFloor(there.y));
      const cv::Rect covered = cv::Rect(corner, cv::Size(2, 2)) & picture;
      for (int v = covered.y; v < covered.br().y; ++v) {
        for (int u = covered.x; u < covered.br().x; ++u)
          nearest(v, u) = std::max(nearest(v, u), relief(y, x));
      }
    }
  }
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const cv::Point there(cvRound(view.map(y, x)[0]), cvRound(view.map(y, x)[1]));
      const double px = cv::norm(motion.perRelief(cv::Point2d(x, y), center, size));
      if (!picture.contains(there) || (nearest(there) - relief(y, x)) * px > kAlignment.hidden)
        view.shown(y, x) = 0;
    }
  }
  return view;
}

}  // namespace all_in_focus::core
