// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/camera.hpp"

namespace all_in_focus::core {

class ZBuffer;

/// What one depth pixel covers in the colour image.
enum class Splat {
  kPoint,      ///< the one pixel nearest to its centre (as printed)
  kFootprint,  ///< every pixel under it: dense at any colour resolution and camera roll
};

/// Depth seen from the colour camera (equations 1 to 3), with z-buffer: of several depths on one pixel the
/// nearest stays. Points outside the image or behind the camera are dropped.
///
/// Rays, pose and intrinsics are folded into three numbers per depth pixel at construction; a call then costs
/// one multiply-add per coordinate. Bands of rows are drawn by several threads; the result does not depend on
/// their number. Not thread-safe: buffers are reused between calls.
class DepthRegistration {
 public:
  /// Throws std::invalid_argument when a camera is impossible.
  explicit DepthRegistration(const Rig& rig, Splat splat = Splat::kFootprint);
  ~DepthRegistration();
  DepthRegistration(const DepthRegistration&) = delete;
  DepthRegistration& operator=(const DepthRegistration&) = delete;

  /// depth: CV_16UC1 mm, 0 = unknown, size of the rig's depth camera (else std::invalid_argument).
  /// registered: CV_16UC1 mm, distance Z' along the colour camera's axis, 0 = unknown, size of the colour
  /// camera.
  void compute(const cv::Mat& depth, cv::Mat& registered);

  const Rig& rig() const { return rig_; }

 private:
  void drawRows(const cv::Mat& depth, const cv::Range& rows, ZBuffer& nearest) const;

  Rig rig_;
  Splat splat_;
  float reach_ = 0;               ///< of the colour camera's distortion
  bool fold_intrinsics_ = false;  ///< rays and translation are in colour pixels already
  cv::Mat1f ray_[3];              ///< per depth pixel: what one mm of depth adds to X', Y', Z'
  cv::Vec3f translation_;
  std::vector<ZBuffer> bands_;  ///< one for each band of rows of the depth image
};

}  // namespace all_in_focus::core
