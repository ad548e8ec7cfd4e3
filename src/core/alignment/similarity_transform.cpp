// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "alignment/similarity_transform.hpp"

#include <algorithm>
#include <cmath>

namespace all_in_focus::core {
namespace {

cv::Point2d rotate(const cv::Point2d& p, double angle) {
  const double cosine = std::cos(angle), sine = std::sin(angle);
  return {cosine * p.x - sine * p.y, sine * p.x + cosine * p.y};
}

}  // namespace

cv::Point2d SimilarityTransform::apply(const cv::Point2d& p, const cv::Point2d& center) const {
  return center + scale * rotate(p - center, angle) + shift;
}

cv::Matx23d SimilarityTransform::matrix(const cv::Point2d& center) const {
  const cv::Point2d origin = apply({}, center), x = apply({1, 0}, center) - origin,
                    y = apply({0, 1}, center) - origin;
  return {x.x, y.x, origin.x, x.y, y.y, origin.y};
}

cv::Point2d CameraMotion::apply(const cv::Point2d& p, double relief, const cv::Point2d& center,
                                const cv::Size& size) const {
  const cv::Point2d outwards = (p - center) / (0.5 * std::hypot(size.width, size.height));
  return SimilarityTransform::apply(p, center) + cv::Point2d(turn).dot(outwards) * outwards +
         relief * (cv::Point2d(parallax[0], parallax[1]) + parallax[2] * outwards);
}

cv::Matx33d CameraMotion::homography(const cv::Point2d& center, const cv::Size& size) const {
  const cv::Vec2d by = turn * (4 / std::pow(std::hypot(size.width, size.height), 2));
  const cv::Matx23d m = matrix(center);
  const cv::Vec3d less(-by[0], -by[1], by[0] * center.x + by[1] * center.y);  // of the scale at a pixel
  cv::Matx33d result = cv::Matx33d::eye();
  for (int i = 0; i < 3; ++i) {
    result(0, i) = m(0, i) + center.x * less[i];
    result(1, i) = m(1, i) + center.y * less[i];
    result(2, i) += less[i];
  }
  return result;
}

SimilarityTransform compose(const SimilarityTransform& first, const SimilarityTransform& second) {
  return {second.scale * first.scale, second.scale * rotate(first.shift, second.angle) + second.shift,
          first.angle + second.angle};
}

SimilarityTransform inverse(const SimilarityTransform& transform) {
  return {1 / transform.scale, rotate(transform.shift, -transform.angle) * (-1 / transform.scale),
          -transform.angle};
}

double largestDisplacement(const SimilarityTransform& transform, const cv::Size& size,
                           const cv::Point2d& center) {
  double largest = 0;
  for (const double x : {0, size.width - 1}) {
    for (const double y : {0, size.height - 1}) {
      const cv::Point2d corner(x, y);
      largest = std::max(largest, cv::norm(transform.apply(corner, center) - corner));
    }
  }
  return largest;
}

cv::Rect seenThrough(const SimilarityTransform& motion, const cv::Size& size, const cv::Point2d& center) {
  const SimilarityTransform back = inverse(motion);
  const int right = size.width - 1, bottom = size.height - 1;
  const cv::Point2d nw = back.apply({0, 0}, center), ne = back.apply(cv::Point(right, 0), center),
                    sw = back.apply(cv::Point(0, bottom), center),
                    se = back.apply(cv::Point(right, bottom), center);
  const cv::Point from(static_cast<int>(std::ceil(std::max(nw.x, sw.x))),
                       static_cast<int>(std::ceil(std::max(nw.y, ne.y))));
  const cv::Point to(static_cast<int>(std::floor(std::min(ne.x, se.x))) + 1,
                     static_cast<int>(std::floor(std::min(sw.y, se.y))) + 1);
  if (to.x <= from.x || to.y <= from.y) return {};  // cv::Rect would swap the corners
  return cv::Rect(from, to) & cv::Rect({}, size);
}

}  // namespace all_in_focus::core
