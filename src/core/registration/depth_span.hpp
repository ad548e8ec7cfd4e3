// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>

#include "all_in_focus/camera.hpp"

namespace all_in_focus::core {

/// A stretch of a row of the depth camera. Rays: what one mm of depth adds to X', Y', Z'.
struct DepthSpan {
  static constexpr int kMost = 256;  ///< pixels; all arrays below stay in the first-level cache

  int count;
  const std::uint16_t* depth;
  const float* ray[3];
  const float* ray_below[3];  ///< of the next row
  float translation[3];
  float fx, fy;  ///< what turns X'/Z' into colour pixels
};

/// The same seen from the colour camera. w: depth along its axis, 0 = nothing to draw.
struct ProjectedSpan {
  float u[DepthSpan::kMost], v[DepthSpan::kMost], w[DepthSpan::kMost];
  float z[DepthSpan::kMost];  ///< depth along the depth camera's axis
};

/// A depth pixel at one depth is a parallelogram in the colour image, spanned by the derivatives of its
/// position after u and v: d(nu / w) = (d nu - u' dw) / w.
struct Footprint {
  Footprint(const DepthSpan& from, const ProjectedSpan& to, int i) : u(to.u[i]), v(to.v[i]) {
    const float z = to.z[i], w = to.w[i], scale = z / w;
    // Before distortion, whose own derivative is left out.
    const float x = (from.ray[0][i] * z + from.translation[0]) / w;
    const float y = (from.ray[1][i] * z + from.translation[1]) / w;
    const float dw1 = from.ray[2][i + 1] - from.ray[2][i], dw2 = from.ray_below[2][i] - from.ray[2][i];
    e1_u = from.fx * scale * (from.ray[0][i + 1] - from.ray[0][i] - x * dw1);
    e1_v = from.fy * scale * (from.ray[1][i + 1] - from.ray[1][i] - y * dw1);
    e2_u = from.fx * scale * (from.ray_below[0][i] - from.ray[0][i] - x * dw2);
    e2_v = from.fy * scale * (from.ray_below[1][i] - from.ray[1][i] - y * dw2);
    area = e1_u * e2_v - e1_v * e2_u;
    to_a = 1.0f / area;
  }

  bool edgeOn() const { return !(std::abs(area) > 1e-6f); }
  float halfWidth() const { return kHalf * (std::abs(e1_u) + std::abs(e2_u)); }
  float halfHeight() const { return kHalf * (std::abs(e1_v) + std::abs(e2_v)); }

  /// Whether it covers the centre of a pixel of the colour image. Along a row or a column the covered ones
  /// are neighbours: both coordinates are monotonic, also after rounding.
  bool covers(int x, int y) const {
    const float dx = x - u, dy = y - v;
    const float along1 = (dx * e2_v - dy * e2_u) * to_a, along2 = (dy * e1_u - dx * e1_v) * to_a;
    return (std::abs(along1) <= kHalf) & (std::abs(along2) <= kHalf);
  }

  /// A footprint reaches this far beyond half a depth pixel: neighbours at slightly other depths are moved
  /// apart by parallax.
  static constexpr float kHalf = 0.5f + 0.1f;

  float u, v;                    ///< centre
  float e1_u, e1_v, e2_u, e2_v;  ///< sides
  float area, to_a;
};

/// What is drawn into. Variables where constants would do: GCC makes one instruction of a limit only then.
struct Frame {
  Frame(const cv::Size& size, int stride)
      : size(size),
        stride(stride),
        cols(static_cast<float>(size.width)),
        rows(static_cast<float>(size.height)) {}
  cv::Size size;
  int stride;  ///< pixels from row to row
  float cols, rows, first = 0, outside = -1;
};

/// Rows of the colour image that a span reaches; none while top > bottom.
struct RowRange {
  int top, bottom;
};

/// The colour pixel nearest to each point.
struct PointSpan {
  std::int32_t at[DepthSpan::kMost];  ///< v * stride + u, or below 0: i - kMost, nothing to draw
  std::uint16_t depth[DepthSpan::kMost];
};

/// Bounding boxes of footprints, inside the image; v1 < 0: nothing to draw.
struct BoxSpan {
  std::int32_t u0[DepthSpan::kMost], v0[DepthSpan::kMost], u1[DepthSpan::kMost], v1[DepthSpan::kMost];
};

/// Footprints in boxes of at most 2x2 pixels, as the depths of these less one; 0xFFFF where not covered.
struct QuadSpan {
  std::int32_t at[DepthSpan::kMost];                               ///< of the first, as in PointSpan
  std::uint32_t upper[DepthSpan::kMost], lower[DepthSpan::kMost];  ///< two neighbours each
};

/// Equations 2 and 3, without the distortion of the colour camera.
void project(const DepthSpan& from, ProjectedSpan& to);
/// Ideal coordinates to pixels of the colour camera; what lies beyond its reach is dropped.
void distort(const Camera& camera, float reach, int count, ProjectedSpan& span);

void toPoints(const ProjectedSpan& from, int count, const Frame& frame, PointSpan& to);
void toBoxes(const DepthSpan& from, const ProjectedSpan& projected, const Frame& frame, BoxSpan& to);
/// False when some box is larger than 2x2: the quads then are of no use.
bool toQuads(const DepthSpan& from, const ProjectedSpan& projected, const Frame& frame, QuadSpan& to);

RowRange rowsOf(const std::int32_t* at, int count, int stride);  ///< of the pixels of points, quads
RowRange rowsOf(const BoxSpan& boxes, int count);

}  // namespace all_in_focus::core
