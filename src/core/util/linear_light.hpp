// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "util/srgb.hpp"

namespace all_in_focus::core {

/// Linear light (0..1) of 8-bit codes. codes: CV_8U, any channels; the result: CV_32F.
cv::Mat linearLight(const cv::Mat& codes, const LightCurve& curve);

}  // namespace all_in_focus::core
