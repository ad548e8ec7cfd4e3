// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "util/srgb.hpp"

namespace all_in_focus::core {

/// The curve by which the frames of a bracket show light: sRGB, or codes in proportion to light.
///
/// Blur spreads light but does not change its sum, so wide means of light are alike in all frames, whatever
/// they are focused on. With the wrong curve the mean of a texture changes as the texture is blurred. The
/// curve counts with which the frames differ less from the fused picture.
///
/// fused: CV_8UC3, as sharp as can be; frames: CV_8UC3 of that size; seen: their valid pixels.
const LightCurve& cameraCurve(const cv::Mat& fused, const std::vector<cv::Mat>& frames,
                              const std::vector<cv::Rect>& seen);

}  // namespace all_in_focus::core
