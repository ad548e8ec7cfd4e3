// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "registration/depth_span.hpp"

#include <algorithm>
#include <climits>

#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

// floor(value + 0.5), clamped to least..most, where least >= -1; NaN gives most.
inline std::int32_t nearestPixel(float value, float least, float most) {
  return static_cast<std::int32_t>(std::max(std::min(most, value), least) + 1.5f) - 1;
}

// Bounding box of a footprint, clipped to the image.
struct Box {
  Box(const Footprint& f, float w, const Frame& frame)
      : u0(nearestPixel(f.u - f.halfWidth() + 0.5f, frame.first, frame.cols)),
        v0(nearestPixel(f.v - f.halfHeight() + 0.5f, frame.first, frame.rows)),
        u1(nearestPixel(f.u + f.halfWidth() - 0.5f, frame.outside, frame.cols - 1)),
        v1(nearestPixel(f.v + f.halfHeight() - 0.5f, frame.outside, frame.rows - 1)),
        drawn((w > 0) & !f.edgeOn() & (u0 <= u1) & (v0 <= v1)) {}
  std::int32_t u0, v0, u1, v1;
  bool drawn;
};

ALL_IN_FOCUS_SIMD void distortByPolynomial(const Camera& camera, float reach, int count,
                                           ProjectedSpan& __restrict span) {
  const auto [k1, k2, p1, p2, k3, k4, k5, k6] = camera.distortion;
  const double fx = camera.fx, fy = camera.fy, cx = camera.cx, cy = camera.cy;
  const float most = reach * reach;
  for (int i = 0; i < count; ++i) {
    const bool folded_back = span.u[i] * span.u[i] + span.v[i] * span.v[i] > most;
    span.w[i] = folded_back ? 0.0f : span.w[i];
    const double x = span.u[i], y = span.v[i], r2 = x * x + y * y;
    const double radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)));
    const double u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x);
    const double v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y;
    span.u[i] = static_cast<float>(u * fx + cx);
    span.v[i] = static_cast<float>(v * fy + cy);
  }
}

}  // namespace

ALL_IN_FOCUS_SIMD void project(const DepthSpan& from, ProjectedSpan& __restrict to) {
  const DepthSpan span = from;  // a copy: so the compiler knows that no store changes it
  const float tx = span.translation[0], ty = span.translation[1], tz = span.translation[2];
  for (int i = 0; i < span.count; ++i) {
    const float z = span.depth[i];
    const float w = span.ray[2][i] * z + tz;
    const float inverse = 1.0f / w;
    to.u[i] = (span.ray[0][i] * z + tx) * inverse;
    to.v[i] = (span.ray[1][i] * z + ty) * inverse;
    const bool visible = (z > 0) & (w >= 0.5f) & (w < 65535.0f);
    to.w[i] = visible ? w : 0.0f;
    to.z[i] = z;
  }
}

// Camera::distort for all points of a span.
void distort(const Camera& camera, float reach, int count, ProjectedSpan& span) {
  if (camera.lens == LensModel::kPolynomial) return distortByPolynomial(camera, reach, count, span);
  for (int i = 0; i < count; ++i) {
    const double u = span.u[i], v = span.v[i];
    if (!(u * u + v * v <= double{reach} * reach)) span.w[i] = 0;
    const cv::Point2d seen = camera.distort({u, v});
    span.u[i] = static_cast<float>(seen.x * camera.fx + camera.cx);
    span.v[i] = static_cast<float>(seen.y * camera.fy + camera.cy);
  }
}

ALL_IN_FOCUS_SIMD void toPoints(const ProjectedSpan& __restrict from, int count, const Frame& frame,
                                PointSpan& __restrict to) {
  const Frame image = frame;
  for (int i = 0; i < count; ++i) {
    const std::int32_t u = nearestPixel(from.u[i], image.outside, image.cols);
    const std::int32_t v = nearestPixel(from.v[i], image.outside, image.rows);
    const bool inside =
        (u >= 0) & (u < image.size.width) & (v >= 0) & (v < image.size.height) & (from.w[i] > 0);
    to.at[i] = inside ? v * image.stride + u : i - DepthSpan::kMost;
    to.depth[i] = static_cast<std::uint16_t>(static_cast<std::int32_t>(from.w[i] + 0.5f) - 1);
  }
}

ALL_IN_FOCUS_SIMD void toBoxes(const DepthSpan& from, const ProjectedSpan& __restrict projected,
                               const Frame& frame, BoxSpan& __restrict to) {
  const DepthSpan span = from;
  const Frame image = frame;
  for (int i = 0; i < span.count; ++i) {
    const Box box(Footprint(span, projected, i), projected.w[i], image);
    to.u0[i] = box.u0;
    to.u1[i] = box.u1;
    to.v0[i] = box.drawn ? box.v0 : INT_MAX;
    to.v1[i] = box.drawn ? box.v1 : -1;
  }
}

ALL_IN_FOCUS_SIMD bool toQuads(const DepthSpan& from, const ProjectedSpan& __restrict projected,
                               const Frame& frame, QuadSpan& __restrict to) {
  const DepthSpan span = from;
  const Frame image = frame;
  std::int32_t sides = 0;  // bits of all sides, each less one
  for (int i = 0; i < span.count; ++i) {
    const Footprint f(span, projected, i);
    const Box b(f, projected.w[i], image);
    const bool wide = b.drawn & (b.u1 > b.u0), high = b.drawn & (b.v1 > b.v0);
    const std::uint32_t depth = static_cast<std::int32_t>(projected.w[i] + 0.5f) - 1;
    const std::uint32_t pair = depth | depth << 16;
    const std::uint32_t no00 = (b.drawn & f.covers(b.u0, b.v0)) ? 0 : 0xFFFF;
    const std::uint32_t no10 = (wide & f.covers(b.u1, b.v0)) ? 0 : 0xFFFF0000;
    const std::uint32_t no01 = (high & f.covers(b.u0, b.v1)) ? 0 : 0xFFFF;
    const std::uint32_t no11 = (wide & high & f.covers(b.u1, b.v1)) ? 0 : 0xFFFF0000;
    to.at[i] = b.drawn ? b.v0 * image.stride + b.u0 : i - DepthSpan::kMost;
    to.upper[i] = pair | no00 | no10;
    to.lower[i] = pair | no01 | no11;
    sides |= b.drawn ? (b.u1 - b.u0) | (b.v1 - b.v0) : 0;
  }
  return sides <= 1;
}

ALL_IN_FOCUS_SIMD cv::Range rowsOf(const std::int32_t* at, int count, int stride) {
  std::uint32_t first = UINT32_MAX;  // negative indices, which are not drawn, are large as unsigned numbers
  std::int32_t last = -1;
  for (int i = 0; i < count; ++i) {
    first = std::min(first, static_cast<std::uint32_t>(at[i]));
    last = std::max(last, at[i]);
  }
  return last < 0 ? cv::Range() : cv::Range(static_cast<int>(first) / stride, last / stride + 1);
}

ALL_IN_FOCUS_SIMD cv::Range rowsOf(const BoxSpan& boxes, int count) {
  int top = INT_MAX, bottom = -1;
  for (int i = 0; i < count; ++i) {
    top = std::min(top, boxes.v0[i]);
    bottom = std::max(bottom, boxes.v1[i]);
  }
  return bottom < 0 ? cv::Range() : cv::Range(top, bottom + 1);
}

}  // namespace all_in_focus::core
