// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// Whether the codes of a bracket are in proportion to light, not sRGB.
///
/// Blur spreads light but does not change its sum, so wide means of light are alike in all frames, whatever
/// they are focused on. With the wrong curve the mean of a texture changes as the texture is blurred. So
/// codes have the curve with which the frames differ less. If nothing tells, it is sRGB.
///
/// reference, others: CV_8UC1 of one size, of one scene.
bool hasLinearCodes(const cv::Mat& reference, const std::vector<cv::Mat>& others);

}  // namespace all_in_focus::core
