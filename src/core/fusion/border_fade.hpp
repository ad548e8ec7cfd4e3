// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// How a frame fades where it ends within the picture, so that no seam is seen there: in proportion to the
/// distance from its end, over half as many pixels as it lacks. What is sharp there is lost, so it does not
/// fade over more.
class BorderFade {
 public:
  /// seen: what the frame shows of a picture of that size.
  void begin(const cv::Rect& seen, const cv::Size& size);

  /// Parts 0..1 of the frame that count in row y, a pixel each; null: all of it counts. The pointer is valid
  /// as long as `buffer` stays as it is.
  const float* row(int y, std::vector<float>& buffer) const;

 private:
  std::vector<float> columns_, rows_;  // parts, of each
  bool columns_fade_ = false;
};

}  // namespace all_in_focus::core
