// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "registration/z_buffer.hpp"

#include <algorithm>
#include <opencv2/core/hal/intrin.hpp>

namespace all_in_focus::core {
namespace {

constexpr std::uint16_t kNone = 0xFFFF;
constexpr int kLanes = 8;

// Footprints of neighbours mostly share pixels. Drawn one after the other, each would wait for the store of
// the one before it, so every eighth is drawn in turn.
constexpr int kApart = 8;

// min(row, depth) for `count` pixels. Up to kLanes - 1 more are read and written back.
inline void drawRow(std::uint16_t* row, int count, std::uint16_t depth) {
  static const std::uint16_t kKeep[2 * kLanes] = {0,     0,     0,     0,     0,     0,     0,     0,
                                                  kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};
  const cv::v_uint16x8 depths = cv::v_setall_u16(depth);
  for (; count > kLanes; count -= kLanes, row += kLanes) cv::v_store(row, cv::v_min(cv::v_load(row), depths));
  cv::v_store(row, cv::v_min(cv::v_load(row), depths | cv::v_load(kKeep + kLanes - count)));
}

// Draws four pixels of a row, u0 to at most u1, where the footprint covers them.
class FourPixels {
 public:
  FourPixels(const Footprint& footprint, int u0, int u1) : f_(footprint) {
    const cv::v_int32x4 u = cv::v_setall_s32(u0) + cv::v_int32x4(0, 1, 2, 3);
    in_box_ = u <= cv::v_setall_s32(u1);
    const cv::v_float32x4 du = cv::v_cvt_f32(u) - cv::v_setall_f32(f_.u);
    du_e1_v_ = du * cv::v_setall_f32(f_.e1_v);
    du_e2_v_ = du * cv::v_setall_f32(f_.e2_v);
  }

  void draw(std::uint16_t* row, int v, std::uint16_t depth) const {
    const float dv = static_cast<float>(v) - f_.v;
    const cv::v_float32x4 to_a = cv::v_setall_f32(f_.to_a), half = cv::v_setall_f32(Footprint::kHalf);
    const cv::v_float32x4 along1 = (du_e2_v_ - cv::v_setall_f32(dv * f_.e2_u)) * to_a;
    const cv::v_float32x4 along2 = (cv::v_setall_f32(dv * f_.e1_u) - du_e1_v_) * to_a;
    const cv::v_int32x4 covered =
        cv::v_reinterpret_as_s32((cv::v_abs(along1) <= half) & (cv::v_abs(along2) <= half)) & in_box_;
    const cv::v_uint16x8 none = ~cv::v_reinterpret_as_u16(cv::v_pack(covered, covered));
    cv::v_store_low(row, cv::v_min(cv::v_load_low(row), cv::v_setall_u16(depth) | none));
  }

 private:
  const Footprint& f_;
  cv::v_int32x4 in_box_;
  cv::v_float32x4 du_e1_v_, du_e2_v_;
};

}  // namespace

void ZBuffer::begin(const cv::Size& image) {
  frame_ = Frame(image, image.width + kLanes);
  const int ahead = DepthSpan::kMost + kLanes;
  memory_.create(1, ahead + (image.height + 1) * frame_.stride);
  origin_ = memory_[0] + ahead;
  std::fill(memory_[0], origin_, kNone);
  top_ = bottom_ = 0;
}

void ZBuffer::clearUpTo(const RowRange& rows) {
  if (rows.top > rows.bottom) return;
  const int bottom = rows.bottom + 2;  // drawing also writes to the row below
  if (top_ == bottom_) top_ = bottom_ = rows.top;
  if (rows.top < top_) std::fill(at(rows.top), at(top_), kNone);
  if (bottom > bottom_) std::fill(at(bottom_), at(bottom), kNone);
  top_ = std::min(top_, rows.top);
  bottom_ = std::max(bottom_, bottom);
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

void ZBuffer::drawBox(int u0, int v0, int u1, int v1, const Footprint& footprint, float w) {
  const auto depth = static_cast<std::uint16_t>(static_cast<int>(w + 0.5f) - 1);
  if (u1 - u0 < 4) {
    const FourPixels pixels(footprint, u0, u1);
    for (int v = v0; v <= v1; ++v) pixels.draw(at(v) + u0, v, depth);
    return;
  }
  for (int v = v0; v <= v1; ++v) {
    int begin = u0, end = u1 + 1;
    while (begin < end && !footprint.covers(begin, v)) ++begin;
    while (begin < end && !footprint.covers(end - 1, v)) --end;
    if (begin < end) drawRow(at(v) + begin, end - begin, depth);
  }
}

}  // namespace all_in_focus::core
