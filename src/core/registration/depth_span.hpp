// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>

#include "all_in_focus/camera.hpp"

namespace all_in_focus::core {

/// Some consecutive pixels of a row of the depth camera. A ray is what one mm of depth adds to X', Y', Z'.
struct DepthSpan {
  static constexpr int kMost = 256;  ///< pixels; so all arrays below stay in the first-level cache

  int count;                   ///< pixels, up to kMost
  const std::uint16_t* depth;  ///< mm, 0 = unknown
  const float* ray[3];         ///< count + 1 rays
  const float* ray_below[3];   ///< of the next row
  float translation[3];        ///< mm
  float fx, fy;                ///< from X'/Z' to colour pixels; 1 if rays include them
};

/// The same pixels as seen from the colour camera.
struct ProjectedSpan {
  float u[DepthSpan::kMost], v[DepthSpan::kMost];  ///< position, colour pixels
  float w[DepthSpan::kMost];  ///< depth along the colour camera's axis, mm; 0 = do not draw
  float z[DepthSpan::kMost];  ///< depth along the depth camera's axis, mm
};

/// The area of the colour image that a depth pixel covers: a parallelogram spanned by the derivatives of its
/// position (u', v') = (n_u, n_v) / w by u and v, where d(n / w) = (dn - u' dw) / w.
struct Footprint {
  Footprint(const DepthSpan& from, const ProjectedSpan& to, int i) : u(to.u[i]), v(to.v[i]) {
    const float z = to.z[i], w = to.w[i], scale = z / w;
    // The derivative of the colour camera's distortion is left out: a footprint is a few pixels.
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

  /// True if it covers the centre of a pixel of the colour image.
  bool covers(int x, int y) const {
    const float dx = static_cast<float>(x) - u, dy = static_cast<float>(y) - v;
    const float along1 = (dx * e2_v - dy * e2_u) * to_a, along2 = (dy * e1_u - dx * e1_v) * to_a;
    const int inside1 = std::abs(along1) <= kHalf, inside2 = std::abs(along2) <= kHalf;
    return (inside1 & inside2) != 0;  // without a branch
  }

  /// Half the side of a depth pixel, and a tenth more: parallax moves neighbours of slightly different depths
  /// apart, which would leave gaps.
  static constexpr float kHalf = 0.5f + 0.1f;

  float u, v;                    ///< centre
  float e1_u, e1_v, e2_u, e2_v;  ///< sides
  float area, to_a;
};

/// The image that is drawn into. `first` and `outside` are variables, not constants, because only then GCC
/// compiles a clamp with them into one instruction.
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

/// The colour pixel nearest to each point.
struct PointSpan {
  std::int32_t at[DepthSpan::kMost];      ///< index v * stride + u; negative, i - kMost: do not draw
  std::uint16_t depth[DepthSpan::kMost];  ///< mm, less one
};

/// Bounding boxes of footprints, clipped to the image: columns u0..u1, rows v0..v1; v1 < 0: do not draw.
struct BoxSpan {
  std::int32_t u0[DepthSpan::kMost], v0[DepthSpan::kMost], u1[DepthSpan::kMost], v1[DepthSpan::kMost];
};

/// Footprints that cover at most 2 x 2 pixels: the depths of these pixels, mm, less one; 0xFFFF = not
/// covered.
struct QuadSpan {
  std::int32_t at[DepthSpan::kMost];      ///< index of the upper left pixel, as in PointSpan
  std::uint32_t upper[DepthSpan::kMost];  ///< two pixels of a row, the left one in the lower half
  std::uint32_t lower[DepthSpan::kMost];  ///< the same, of the row below
};

/// Projects to the colour camera (equations 2 and 3), without its distortion.
void project(const DepthSpan& from, ProjectedSpan& to);
/// Turns ideal coordinates into pixels of a distorted colour camera. Points beyond `reach` are not drawn.
void distort(const Camera& camera, float reach, int count, ProjectedSpan& span);

void toPoints(const ProjectedSpan& from, int count, const Frame& frame, PointSpan& to);
void toBoxes(const DepthSpan& from, const ProjectedSpan& projected, const Frame& frame, BoxSpan& to);
/// Returns false if a footprint covers more than 2 x 2 pixels; `to` is of no use then.
bool toQuads(const DepthSpan& from, const ProjectedSpan& projected, const Frame& frame, QuadSpan& to);

/// Rows of the colour image that points or quads, or boxes, are drawn to.
cv::Range rowsOf(const std::int32_t* at, int count, int stride);
cv::Range rowsOf(const BoxSpan& boxes, int count);

}  // namespace all_in_focus::core
