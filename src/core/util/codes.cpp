// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/codes.hpp"

namespace all_in_focus::core {

cv::Mat toBits(const cv::Mat& image, int depth) {
  if (image.depth() == depth) return image;
  cv::Mat codes;
  image.convertTo(codes, depth, depth == CV_16U ? kDeepPerCode : 1 / kDeepPerCode);
  return codes;
}

int whiteCode(int highest) {
  for (const int bits : {8, 10, 12, 14}) {
    if (highest > 0 && highest < 1 << bits) return (1 << bits) - 1;
  }
  return 65535;
}

}  // namespace all_in_focus::core
