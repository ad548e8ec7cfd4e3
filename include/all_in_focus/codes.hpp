// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

namespace all_in_focus::core {

constexpr double kDeepPerCode = 257;  ///< codes of 16 bits for one of 8: 65535 / 255

/// The same picture with codes of 8 or 16 bits. depth: CV_8U or CV_16U. One that has them is not copied.
cv::Mat toBits(const cv::Mat& image, int depth);

/// toBits() with 8 bits: what evidence and pictures for people need.
inline cv::Mat toEightBits(const cv::Mat& image) {
  return toBits(image, CV_8U);
}

/// The code of white in pictures with 16 bits whose highest code is that: cameras of 8 to 14 bits write files
/// and messages of 16.
int whiteCode(int highest);

}  // namespace all_in_focus::core
