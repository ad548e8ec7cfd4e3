// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <climits>
#include <cmath>
#include <opencv2/core.hpp>

#include "all_in_focus/depth_registration.hpp"
#include "all_in_focus/hole_filling.hpp"

namespace all_in_focus::core {

/// Registration straight from its definition, pixel by pixel: slow and plain, with the roundings of the fast
/// one.
class ReferenceRegistration {
 public:
  ReferenceRegistration(const Rig& rig, Splat splat) : rig_(rig), splat_(splat) {
    const Camera& out = rig.color;
    folded_ = !out.distorted();
    const cv::Matx33d K =
        folded_ ? cv::Matx33d(out.fx, 0, out.cx, 0, out.fy, out.cy, 0, 0, 1) : cv::Matx33d::eye();
    KR_ = K * rig.depth_to_color.rotation;
    t_ = cv::Vec3f(K * rig.depth_to_color.translation_mm);
    ray_.create(rig.depth.size + cv::Size(1, 1));
    for (int v = 0; v < ray_.rows; ++v) {
      for (int u = 0; u < ray_.cols; ++u) ray_(v, u) = ray(u, v);
    }
  }

  cv::Mat compute(const cv::Mat& depth) const {
    cv::Mat registered = cv::Mat::zeros(rig_.color.size, CV_16UC1);
    for (int v = 0; v < depth.rows; ++v) {
      for (int u = 0; u < depth.cols; ++u) draw(u, v, depth.at<std::uint16_t>(v, u), registered);
    }
    return registered;
  }

 private:
  cv::Vec3f ray(int u, int v) const {
    const Camera& in = rig_.depth;
    const cv::Point2d ideal = in.undistort({(u - in.cx) / in.fx, (v - in.cy) / in.fy});
    return cv::Vec3f(KR_ * cv::Vec3d(ideal.x, ideal.y, 1.0));
  }

  void draw(int u, int v, float z, cv::Mat& registered) const {
    const cv::Vec3f& r = ray_(v, u);
    const float w = r[2] * z + t_[2];
    if (!(z > 0 && w >= 0.5f && w < 65535.0f)) return;
    const float inverse = 1.0f / w;
    cv::Point2f p((r[0] * z + t_[0]) * inverse, (r[1] * z + t_[1]) * inverse);
    if (!folded_) {
      const auto reach = static_cast<float>(rig_.color.reach());
      if (p.x * p.x + p.y * p.y > reach * reach) return;
      const cv::Point2d distorted = rig_.color.distort({p.x, p.y});
      p.x = static_cast<float>(distorted.x * rig_.color.fx + rig_.color.cx);
      p.y = static_cast<float>(distorted.y * rig_.color.fy + rig_.color.cy);
    }
    const auto mm = static_cast<std::uint16_t>(w + 0.5f);
    if (splat_ == Splat::kPoint) {
      keepNearest(nearest(p.x), nearest(p.y), mm, registered);
    } else {
      drawFootprint(r, ray_(v, u + 1), ray_(v + 1, u), z, w, p, mm, registered);
    }
  }

  void drawFootprint(const cv::Vec3f& r, const cv::Vec3f& right, const cv::Vec3f& below, float z, float w,
                     const cv::Point2f& p, std::uint16_t mm, cv::Mat& registered) const {
    const float fx = folded_ ? 1.0f : static_cast<float>(rig_.color.fx);
    const float fy = folded_ ? 1.0f : static_cast<float>(rig_.color.fy);
    const float scale = z / w, x = (r[0] * z + t_[0]) / w, y = (r[1] * z + t_[1]) / w;
    const auto side = [&](const cv::Vec3f& to) {
      const float dw = to[2] - r[2];
      return cv::Point2f(fx * scale * (to[0] - r[0] - x * dw), fy * scale * (to[1] - r[1] - y * dw));
    };
    const cv::Point2f e1 = side(right), e2 = side(below);
    const float area = e1.x * e2.y - e1.y * e2.x;
    if (!(std::abs(area) > 1e-6f)) return;
    constexpr float kHalf = 0.5f + 0.1f;
    const float half_u = kHalf * (std::abs(e1.x) + std::abs(e2.x));
    const float half_v = kHalf * (std::abs(e1.y) + std::abs(e2.y));
    const float to_a = 1.0f / area;
    for (int v = nearest(p.y - half_v + 0.5f); v <= nearest(p.y + half_v - 0.5f); ++v) {
      for (int u = nearest(p.x - half_u + 0.5f); u <= nearest(p.x + half_u - 0.5f); ++u) {
        const float du = static_cast<float>(u) - p.x, dv = static_cast<float>(v) - p.y;
        const float along1 = (du * e2.y - dv * e2.x) * to_a, along2 = (dv * e1.x - du * e1.y) * to_a;
        if (std::abs(along1) <= kHalf && std::abs(along2) <= kHalf) keepNearest(u, v, mm, registered);
      }
    }
  }

  // Limited to what is just outside the image.
  int nearest(float value) const {
    const auto outside = static_cast<float>(std::max(rig_.color.size.width, rig_.color.size.height));
    return static_cast<int>(std::floor(std::min(std::max(-1.0f, value), outside) + 1.5f)) - 1;
  }

  static void keepNearest(int u, int v, std::uint16_t mm, cv::Mat& registered) {
    if (u < 0 || v < 0 || u >= registered.cols || v >= registered.rows) return;
    auto& stored = registered.at<std::uint16_t>(v, u);
    if (stored == 0 || mm < stored) stored = mm;
  }

  Rig rig_;
  Splat splat_;
  bool folded_ = false;
  cv::Matx33d KR_;
  cv::Vec3f t_;
  cv::Mat3f ray_;
};

/// Equation 4.
inline cv::Mat referenceDilation(const cv::Mat& depth) {
  cv::Mat dilated(depth.size(), CV_16UC1);
  for (int i = 0; i < depth.rows; ++i) {
    for (int j = 0; j < depth.cols; ++j) {
      std::uint16_t largest = 0;
      for (int y = std::max(0, i - 1); y <= std::min(i + 1, depth.rows - 1); ++y) {
        for (int x = std::max(0, j - 1); x <= std::min(j + 1, depth.cols - 1); ++x) {
          largest = std::max(largest, depth.at<std::uint16_t>(y, x));
        }
      }
      dilated.at<std::uint16_t>(i, j) = largest;
    }
  }
  return dilated;
}

/// Equations 5 to 8.
inline cv::Mat referenceDiffusion(cv::Mat depth) {
  constexpr double K = 25;
  const auto at = [&](int i, int j) -> std::uint16_t& { return depth.at<std::uint16_t>(i, j); };
  for (int i = 3; i < depth.rows; ++i) {
    for (int j = 0; j < depth.cols; ++j) {
      const int here = at(i - 2, j);
      if (at(i, j) >= 10 || here < 10) continue;
      const auto flow = [&](int neighbour) {
        const int d = neighbour - here;
        return std::abs(d) > 8 * K ? 0.0 : std::exp(-(d / K) * (d / K)) * d;
      };
      double flows = flow(at(i - 3, j)) + flow(at(i - 1, j));
      if (j > 0) flows += flow(at(i - 2, j - 1));
      if (j + 1 < depth.cols) flows += flow(at(i - 2, j + 1));
      at(i, j) = static_cast<std::uint16_t>(here + 0.25 * flows + 0.5);
    }
  }
  return depth;
}

/// Filling from the far side, hole pixel by hole pixel.
inline cv::Mat referenceFarSide(const cv::Mat& depth) {
  cv::Mat filled = depth.clone();
  const auto inside = [&](int i, int j) { return i >= 0 && j >= 0 && i < depth.rows && j < depth.cols; };
  for (int i = 0; i < depth.rows; ++i) {
    for (int j = 0; j < depth.cols; ++j) {
      if (depth.at<std::uint16_t>(i, j) != 0) continue;
      int length[2];
      std::uint16_t farther[2];
      for (const int down : {0, 1}) {
        int begin = 0, end = 0;
        const auto known = [&](int steps, std::uint16_t& mm) {
          const int y = i + down * steps, x = j + (1 - down) * steps;
          mm = inside(y, x) ? depth.at<std::uint16_t>(y, x) : 0;
          return !inside(y, x) || mm != 0;
        };
        std::uint16_t first = 0, last = 0;
        while (!known(begin, first)) --begin;
        while (!known(end, last)) ++end;
        length[down] = first != 0 && last != 0 ? end - begin - 1 : INT_MAX;
        farther[down] = length[down] < INT_MAX ? std::max(first, last) : 0;
      }
      filled.at<std::uint16_t>(i, j) = length[1] < length[0] ? farther[1] : farther[0];
    }
  }
  return filled;
}

}  // namespace all_in_focus::core
