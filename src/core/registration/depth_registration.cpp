// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/depth_registration.hpp"

#include <algorithm>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "registration/z_buffer.hpp"
#include "util/row_strips.hpp"
#include "util/simd.hpp"

namespace all_in_focus::core {
namespace {

constexpr int kMinBandRows = 16;
constexpr int kMinPixelsPerThread = 64 * 1024;

ALL_IN_FOCUS_SIMD void fromZBuffer(const std::uint16_t* __restrict stored, int cols,
                                   std::uint16_t* __restrict row) {
  for (int u = 0; u < cols; ++u) row[u] = stored[u] + 1;
}

ALL_IN_FOCUS_SIMD void keepNearest(const std::uint16_t* __restrict stored, int cols,
                                   std::uint16_t* __restrict row) {
  for (int u = 0; u < cols; ++u) {
    const std::uint16_t so_far = row[u] - 1;
    row[u] = std::min(so_far, stored[u]) + 1;
  }
}

}  // namespace

DepthRegistration::DepthRegistration(const Rig& rig, Splat splat) : rig_(rig), splat_(splat) {
  validate(rig.depth, "depth");
  validate(rig.color, "colour");
  const Camera& in = rig.depth;
  const Camera& out = rig.color;
  // Without distortion the colour camera's intrinsics are part of the same product (equation 3).
  fold_intrinsics_ = !out.distorted();
  reach_ = static_cast<float>(out.reach());
  const cv::Matx33d K =
      fold_intrinsics_ ? cv::Matx33d(out.fx, 0, out.cx, 0, out.fy, out.cy, 0, 0, 1) : cv::Matx33d::eye();
  const cv::Matx33d KR = K * rig.depth_to_color.rotation;
  const cv::Vec3d Kt = K * rig.depth_to_color.translation_mm;
  translation_ = cv::Vec3f(Kt);

  // One column and one row more than the image: differences of rays give the sides of the last footprints.
  for (cv::Mat1f& component : ray_) component.create(in.size.height + 1, in.size.width + 1);
  inParallel(in.size.height + 1, [&](int v) {
    for (int u = 0; u <= in.size.width; ++u) {
      const cv::Point2d ray = in.ray(cv::Point2d(u, v));      // equation 1, Z = 1
      const cv::Vec3d r = KR * cv::Vec3d(ray.x, ray.y, 1.0);  // equation 2
      for (int i = 0; i < 3; ++i) ray_[i](v, u) = static_cast<float>(r[i]);
    }
  });
}

DepthRegistration::~DepthRegistration() = default;

void DepthRegistration::compute(const cv::Mat& depth, cv::Mat& registered) {
  if (depth.type() != CV_16UC1) throw std::invalid_argument("registration: depth must be CV_16UC1 mm");
  if (depth.size() != rig_.depth.size) {
    throw std::invalid_argument(
        cv::format("registration: depth is %dx%d, but the depth camera is calibrated for %dx%d", depth.cols,
                   depth.rows, rig_.depth.size.width, rig_.depth.size.height));
  }
  const int count = stripCount(depth.rows, kMinBandRows);
  if (static_cast<int>(bands_.size()) < count) bands_.resize(count);
  RowStrips({0, depth.rows}, count).forEach([&](const cv::Range& rows, int i) {
    bands_[i].begin(rig_.color.size);
    drawRows(depth, rows, bands_[i]);
  });

  registered.create(rig_.color.size, CV_16UC1);
  const auto merge = [&](int v) {
    auto* const row = registered.ptr<std::uint16_t>(v);
    bool reached = false;
    for (int i = 0; i < count; ++i) {
      const std::uint16_t* const stored = bands_[i].row(v);
      if (!stored) continue;
      (reached ? keepNearest : fromZBuffer)(stored, registered.cols, row);
      reached = true;
    }
    if (!reached) std::fill_n(row, registered.cols, 0);
  };
  inParallel(registered.rows, merge, static_cast<double>(registered.total()) / kMinPixelsPerThread);
}

void DepthRegistration::drawRows(const cv::Mat& depth, const cv::Range& rows, ZBuffer& nearest) const {
  DepthSpan span;
  ProjectedSpan projected;
  std::copy_n(translation_.val, 3, span.translation);
  span.fx = fold_intrinsics_ ? 1.0f : static_cast<float>(rig_.color.fx);
  span.fy = fold_intrinsics_ ? 1.0f : static_cast<float>(rig_.color.fy);
  for (int v = rows.start; v < rows.end; ++v) {
    for (int u = 0; u < depth.cols; u += DepthSpan::kMost) {
      span.count = std::min(depth.cols - u, DepthSpan::kMost);
      span.depth = depth.ptr<std::uint16_t>(v) + u;
      for (int i = 0; i < 3; ++i) span.ray[i] = ray_[i][v] + u, span.ray_below[i] = ray_[i][v + 1] + u;
      project(span, projected);
      if (!fold_intrinsics_) distort(rig_.color, reach_, span.count, projected);
      if (splat_ == Splat::kPoint) {
        nearest.drawPoints(projected, span.count);
      } else {
        nearest.drawFootprints(span, projected);
      }
    }
  }
}

void resizeDepth(const cv::Mat& depth, const cv::Size& size, cv::Mat& resized) {
  // Enlarges a copy: cv::resize reads two bytes beside its source where it enlarges nine times and more.
  const cv::Mat source = size.width > depth.cols ? depth.clone() : depth;
  cv::resize(source, resized, size, 0, 0, cv::INTER_NEAREST);
}

cv::Mat1f inverseDepthOf(const cv::Mat& depth, const cv::Size& size) {
  cv::Mat resized;
  cv::Mat1f inverse_depth;
  resizeDepth(depth, size, resized);
  cv::divide(1, resized, inverse_depth, CV_32F);
  inverse_depth.setTo(0, resized == 0);
  return inverse_depth;
}

}  // namespace all_in_focus::core
