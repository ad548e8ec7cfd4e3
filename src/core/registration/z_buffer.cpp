// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "registration/z_buffer.hpp"

#include <algorithm>
#include <opencv2/core/hal/intrin.hpp>

namespace all_in_focus::core {
namespace {

constexpr std::uint16_t kNone = 0xFFFF;
constexpr int kAtOnce = 4;  // pixels of a row

// Footprints of neighbours mostly share pixels. Drawn one after the other, each would wait for the store of
// the one before it, so every eighth is drawn in turn.
constexpr int kApart = 8;

}  // namespace

void ZBuffer::begin(const cv::Size& image) {
  frame_ = Frame(image, image.width + kAtOnce);
  const int ahead = DepthSpan::kMost + kAtOnce;
  memory_.create(1, ahead + (image.height + 1) * frame_.stride);
  origin_ = memory_[0] + ahead;
  std::fill(memory_[0], origin_, kNone);
  cleared_ = {};
}

void ZBuffer::clearUpTo(const cv::Range& rows) {
  if (rows.empty()) return;
  const int end = rows.end + 1;  // drawing also writes to the row below
  if (cleared_.empty()) cleared_ = {rows.start, rows.start};
  if (rows.start < cleared_.start) std::fill(at(rows.start), at(cleared_.start), kNone);
  if (end > cleared_.end) std::fill(at(cleared_.end), at(end), kNone);
  cleared_ = {std::min(cleared_.start, rows.start), std::max(cleared_.end, end)};
}

void ZBuffer::drawPoints(const ProjectedSpan& projected, int count) {
  PointSpan points;
  toPoints(projected, count, frame_, points);
  clearUpTo(rowsOf(points.at, count, frame_.stride));
  for (int i = 0; i < count; ++i) {
    std::uint16_t& stored = origin_[points.at[i]];
    stored = std::min(stored, points.depth[i]);
  }
}

void ZBuffer::drawFootprints(const DepthSpan& from, const ProjectedSpan& projected) {
  if (small_) {
    QuadSpan quads;
    small_ = toQuads(from, projected, frame_, quads);
    if (small_) {
      drawQuads(quads, from.count);
      return;
    }
  }
  BoxSpan boxes;
  toBoxes(from, projected, frame_, boxes);
  clearUpTo(rowsOf(boxes, from.count));
  small_ = true;
  for (int first = 0; first < kApart; ++first) {
    for (int i = first; i < from.count; i += kApart) {
      if (boxes.v1[i] < 0) continue;
      drawBox(boxes.u0[i], boxes.v0[i], boxes.u1[i], boxes.v1[i], Footprint(from, projected, i),
              projected.w[i]);
      small_ &= boxes.u1[i] - boxes.u0[i] < 2 && boxes.v1[i] - boxes.v0[i] < 2;
    }
  }
}

void ZBuffer::drawQuads(const QuadSpan& quads, int count) {
  clearUpTo(rowsOf(quads.at, count, frame_.stride));
  for (int first = 0; first < kApart; ++first) {
    for (int i = first; i < count; i += kApart) {
      std::uint16_t* const upper = origin_ + quads.at[i];
      std::uint16_t* const lower = upper + frame_.stride;
      const cv::v_uint16x8 drawn =
          cv::v_reinterpret_as_u16(cv::v_uint32x4(quads.upper[i], UINT32_MAX, quads.lower[i], UINT32_MAX));
      const cv::v_uint16x8 nearest = cv::v_min(cv::v_load_halves(upper, lower), drawn);
      cv::v_store_low(upper, nearest);
      cv::v_store_high(lower, nearest);
    }
  }
}

void ZBuffer::drawBox(int u0, int v0, int u1, int v1, const Footprint& f, float w) {
  const auto depth = cv::v_setall_u16(static_cast<std::uint16_t>(static_cast<int>(w + 0.5f) - 1));
  const cv::v_float32x4 to_a = cv::v_setall_f32(f.to_a), half = cv::v_setall_f32(Footprint::kHalf);
  for (int u = u0; u <= u1; u += kAtOnce) {
    const cv::v_int32x4 columns = cv::v_setall_s32(u) + cv::v_int32x4(0, 1, 2, 3);
    const cv::v_int32x4 in_box = columns <= cv::v_setall_s32(u1);
    const cv::v_float32x4 du = cv::v_cvt_f32(columns) - cv::v_setall_f32(f.u);
    const cv::v_float32x4 du_e1_v = du * cv::v_setall_f32(f.e1_v), du_e2_v = du * cv::v_setall_f32(f.e2_v);
    for (int v = v0; v <= v1; ++v) {  // as Footprint::covers()
      const float dv = static_cast<float>(v) - f.v;
      const cv::v_float32x4 along1 = (du_e2_v - cv::v_setall_f32(dv * f.e2_u)) * to_a;
      const cv::v_float32x4 along2 = (cv::v_setall_f32(dv * f.e1_u) - du_e1_v) * to_a;
      const cv::v_int32x4 covered =
          cv::v_reinterpret_as_s32((cv::v_abs(along1) <= half) & (cv::v_abs(along2) <= half)) & in_box;
      const cv::v_uint16x8 none = ~cv::v_reinterpret_as_u16(cv::v_pack(covered, covered));
      std::uint16_t* const pixels = at(v) + u;
      cv::v_store_low(pixels, cv::v_min(cv::v_load_low(pixels), depth | none));
    }
  }
}

}  // namespace all_in_focus::core
