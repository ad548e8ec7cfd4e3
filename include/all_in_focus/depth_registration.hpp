// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "all_in_focus/camera.hpp"

namespace all_in_focus::core {

class ZBuffer;

/// Which pixels of the colour image a depth pixel is drawn to.
enum class Splat {
  kPoint,      ///< the one nearest to its centre (as printed in the paper)
  kFootprint,  ///< all that its outline covers: no gaps at any colour resolution and camera roll
};

/// Depth as seen from the colour camera (equations 1 to 3). Where several depths fall on one pixel the
/// nearest stays (z-buffer). Points outside the image, behind the camera or beyond 65.5 m are dropped.
///
/// The constructor multiplies ray, pose and intrinsics into three numbers per depth pixel, so that a call
/// costs one multiply-add per coordinate. Bands of rows are drawn by several threads; the result does not
/// depend on their number. Not thread-safe: buffers are reused between calls.
class DepthRegistration {
 public:
  /// Throws std::invalid_argument if validate() refuses a camera.
  explicit DepthRegistration(const Rig& rig, Splat splat = Splat::kFootprint);
  ~DepthRegistration();
  DepthRegistration(const DepthRegistration&) = delete;
  DepthRegistration& operator=(const DepthRegistration&) = delete;

  /// depth: CV_16UC1 mm, 0 = unknown, of the size of the rig's depth camera; throws std::invalid_argument on
  /// another type or size. registered: CV_16UC1 mm, distance Z' along the colour camera's axis, 0 = unknown,
  /// of the size of the colour camera.
  void compute(const cv::Mat& depth, cv::Mat& registered);

  const Rig& rig() const { return rig_; }  ///< as given

 private:
  void drawRows(const cv::Mat& depth, const cv::Range& rows, ZBuffer& nearest) const;

  Rig rig_;
  Splat splat_;
  float reach_ = 0;               ///< Camera::reach() of the colour camera
  bool fold_intrinsics_ = false;  ///< rays and translation include the colour camera's intrinsics
  cv::Mat1f ray_[3];              ///< per depth pixel: what one mm of depth adds to X', Y', Z'
  cv::Vec3f translation_;
  std::vector<ZBuffer> bands_;  ///< one for each band of rows of the depth image
};

/// Resizes depth: every pixel takes the nearest one, because the mean of two depths may be the depth of
/// nothing. depth, resized: CV_16UC1. The memory of `resized` is used again where it has the size already.
void resizeDepth(const cv::Mat& depth, const cv::Size& size, cv::Mat& resized);

/// Inverse of depth that resizeDepth() has brought to a size: CV_16UC1 mm to 1/mm, 0 = unknown in both.
cv::Mat1f inverseDepthOf(const cv::Mat& depth, const cv::Size& size);

}  // namespace all_in_focus::core
