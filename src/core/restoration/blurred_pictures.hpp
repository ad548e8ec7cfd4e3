// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// A sharp picture as it looks at every amount of defocus: blurred by discs of growing radius.
class BlurredPictures {
 public:
  /// light: linear light; largest: radius in px, cut at DiscKernels::kLargestPx.
  BlurredPictures(const cv::Mat3f& light, double largest);

  /// Codes times kCodeScale, of the radius nearest to this one.
  const cv::Mat3s& at(float radius) const { return codes_[index(radius)]; }
  int index(float radius) const;
  int count() const { return static_cast<int>(codes_.size()); }
  const cv::Mat3s& operator[](int index) const { return codes_[index]; }

 private:
  std::vector<cv::Mat3s> codes_;
};

}  // namespace all_in_focus::core
