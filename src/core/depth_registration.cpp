// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/depth_registration.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>

namespace all_in_focus::core {
namespace {

// A footprint reaches this far beyond half a depth pixel: neighbours at slightly other depths are moved apart
// by parallax.
constexpr float kFootprintHalf = 0.5f + 0.1f;

// The nearest depth stays. 0 (nothing yet) wraps around to the farthest.
inline void keepNearest(std::uint16_t& stored, std::uint16_t depth) {
  if (static_cast<std::uint16_t>(depth - 1) < static_cast<std::uint16_t>(stored - 1)) stored = depth;
}

// floor(value + 0.5) limited to -1..size, both of which lie outside the image; NaN becomes -1.
inline std::int32_t nearestPixel(float value, float size) {
  return static_cast<std::int32_t>(std::min(std::max(-1.0f, value), size) + 1.5f) - 1;
}

}  // namespace

DepthRegistration::DepthRegistration(const Rig& rig, Splat splat) : rig_(rig), splat_(splat) {
  validate(rig.depth, "depth");
  validate(rig.color, "colour");
  const Camera& in = rig.depth;
  const Camera& out = rig.color;
  // With an undistorted colour camera its intrinsics belong to the fold too (equation 3).
  fold_intrinsics_ = !out.distorted();
  reach_ = static_cast<float>(out.reach());
  const cv::Matx33d K =
      fold_intrinsics_ ? cv::Matx33d(out.fx, 0, out.cx, 0, out.fy, out.cy, 0, 0, 1) : cv::Matx33d::eye();
  const cv::Matx33d KR = K * rig.depth_to_color.rotation;
  const cv::Vec3d Kt = K * rig.depth_to_color.translation_mm;
  translation_ = cv::Vec3f(Kt);

  // One column and one row more than pixels: differences to them give the footprint's sides.
  for (cv::Mat1f& component : ray_) component.create(in.size.height + 1, in.size.width + 1);
  for (int v = 0; v <= in.size.height; ++v) {
    for (int u = 0; u <= in.size.width; ++u) {
      const cv::Point2d ideal =
          in.undistort({(u - in.cx) / in.fx, (v - in.cy) / in.fy});  // equation 1, Z = 1
      const cv::Vec3d r = KR * cv::Vec3d(ideal.x, ideal.y, 1.0);     // equation 2
      for (int i = 0; i < 3; ++i) ray_[i](v, u) = static_cast<float>(r[i]);
    }
  }
  row_.resize(in.size.width);
}

void DepthRegistration::compute(const cv::Mat& depth, cv::Mat& registered) {
  if (depth.type() != CV_16UC1) throw std::invalid_argument("registration: depth must be CV_16UC1 mm");
  if (depth.size() != rig_.depth.size) {
    throw std::invalid_argument(
        cv::format("registration: depth is %dx%d, but the depth camera is calibrated for %dx%d", depth.cols,
                   depth.rows, rig_.depth.size.width, rig_.depth.size.height));
  }
  registered.create(rig_.color.size, CV_16UC1);
  registered.setTo(0);
  for (int v = 0; v < depth.rows; ++v) {
    projectRow(depth.ptr<std::uint16_t>(v), v);
    if (splat_ == Splat::kPoint) {
      splatPoints(registered);
    } else {
      splatFootprints(depth.ptr<std::uint16_t>(v), v, registered);
    }
  }
}

// Equations 2 and 3 for one row: position in the colour image and depth along its axis, 0 = nothing to draw.
void DepthRegistration::projectRow(const std::uint16_t* depth, int v) {
  const float* a = ray_[0][v];
  const float* b = ray_[1][v];
  const float* c = ray_[2][v];
  const float tx = translation_[0], ty = translation_[1], tz = translation_[2];
  const int width = rig_.depth.size.width;
  float* const us = row_.u.data();
  float* const vs = row_.v.data();
  float* const ws = row_.w.data();
  for (int u = 0; u < width; ++u) {
    const float z = depth[u];
    const float w = c[u] * z + tz;
    const float inverse = 1.0f / w;
    us[u] = (a[u] * z + tx) * inverse;
    vs[u] = (b[u] * z + ty) * inverse;
    const bool visible = (z > 0) & (w >= 0.5f) & (w < 65535.0f);
    ws[u] = visible ? w : 0.0f;
  }
  if (fold_intrinsics_) return;
  const Camera& color = rig_.color;
  for (int u = 0; u < width; ++u) {
    if (ws[u] == 0) continue;
    if (us[u] * us[u] + vs[u] * vs[u] > reach_ * reach_) {
      ws[u] = 0;  // would be folded back into the picture
      continue;
    }
    const cv::Point2d p = color.distort({us[u], vs[u]});
    us[u] = static_cast<float>(p.x * color.fx + color.cx);
    vs[u] = static_cast<float>(p.y * color.fy + color.cy);
  }
}

void DepthRegistration::splatPoints(cv::Mat& registered) {
  const int cols = registered.cols, rows = registered.rows, width = rig_.depth.size.width;
  const int stride = static_cast<int>(registered.step1());
  const float* us = row_.u.data();
  const float* vs = row_.v.data();
  const float* ws = row_.w.data();
  std::int32_t* const at = row_.pixel.data();
  for (int i = 0; i < width; ++i) {
    const std::int32_t u = nearestPixel(us[i], static_cast<float>(cols));
    const std::int32_t v = nearestPixel(vs[i], static_cast<float>(rows));
    const bool inside = (u >= 0) & (u < cols) & (v >= 0) & (v < rows) & (ws[i] > 0);
    at[i] = inside ? v * stride + u : -1;
  }
  std::uint16_t* const out = registered.ptr<std::uint16_t>();
  for (int i = 0; i < width; ++i) {
    if (at[i] >= 0) keepNearest(out[at[i]], static_cast<std::uint16_t>(ws[i] + 0.5f));
  }
}

// A depth pixel at one depth is a parallelogram in the colour image, spanned by the derivatives of its
// position after u and v: d(nu / w) = (d nu - u' dw) / w.
void DepthRegistration::splatFootprints(const std::uint16_t* depth_row, int v, cv::Mat& registered) {
  const int cols = registered.cols, rows = registered.rows, width = rig_.depth.size.width;
  const float* row[3] = {ray_[0][v], ray_[1][v], ray_[2][v]};
  const float* below[3] = {ray_[0][v + 1], ray_[1][v + 1], ray_[2][v + 1]};
  const float fx = fold_intrinsics_ ? 1.0f : static_cast<float>(rig_.color.fx);
  const float fy = fold_intrinsics_ ? 1.0f : static_cast<float>(rig_.color.fy);
  for (int i = 0; i < width; ++i) {
    const float w = row_.w[i];
    if (w == 0) continue;
    const float pu = row_.u[i], pv = row_.v[i];
    const float scale = depth_row[i] / w;
    // Before distortion, whose own derivative is left out.
    const float x = (row[0][i] * depth_row[i] + translation_[0]) / w;
    const float y = (row[1][i] * depth_row[i] + translation_[1]) / w;
    const auto side = [&](const float* const* to, int j) {
      const float dw = to[2][j] - row[2][i];
      return cv::Point2f(fx * scale * (to[0][j] - row[0][i] - x * dw),
                         fy * scale * (to[1][j] - row[1][i] - y * dw));
    };
    const cv::Point2f e1 = side(row, i + 1), e2 = side(below, i);
    const float area = e1.x * e2.y - e1.y * e2.x;
    if (!(std::abs(area) > 1e-6f)) continue;  // seen edge-on
    const float half_u = kFootprintHalf * (std::abs(e1.x) + std::abs(e2.x));
    const float half_v = kFootprintHalf * (std::abs(e1.y) + std::abs(e2.y));
    const int u_begin = nearestPixel(std::max(pu - half_u + 0.5f, 0.0f), static_cast<float>(cols));
    const int u_end = nearestPixel(pu + half_u - 0.5f, static_cast<float>(cols - 1));
    const int v_begin = nearestPixel(std::max(pv - half_v + 0.5f, 0.0f), static_cast<float>(rows));
    const int v_end = nearestPixel(pv + half_v - 0.5f, static_cast<float>(rows - 1));
    const auto depth = static_cast<std::uint16_t>(w + 0.5f);
    const float to_a = 1.0f / area;
    for (int y_pixel = v_begin; y_pixel <= v_end; ++y_pixel) {
      std::uint16_t* const out = registered.ptr<std::uint16_t>(y_pixel);
      for (int x_pixel = u_begin; x_pixel <= u_end; ++x_pixel) {
        const float dx = x_pixel - pu, dy = y_pixel - pv;
        const float along1 = (dx * e2.y - dy * e2.x) * to_a, along2 = (dy * e1.x - dx * e1.y) * to_a;
        if (std::abs(along1) <= kFootprintHalf && std::abs(along2) <= kFootprintHalf)
          keepNearest(out[x_pixel], depth);
      }
    }
  }
}

}  // namespace all_in_focus::core
