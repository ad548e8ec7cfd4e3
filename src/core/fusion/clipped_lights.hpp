// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// Where small white areas lie amid darker ones, and what is within 12 px of them (in a picture 640 px wide):
/// lamps, reflections, gaps in leaves. They are clipped, so that blur does not make them fainter: the more
/// such a light is blurred, the larger its white disc is, and the sharper the picture looks from afar.
///
/// gray: CV_8UC1, not empty. White is 250 and more in a block of 2 x 2 px (again of 640). An area is small if
/// it fills less than 15 % of the window. Returns CV_8UC1, about 320 px wide, 255 there, else 0; empty if
/// there are no lights.
cv::Mat clippedLights(const cv::Mat& gray);

}  // namespace all_in_focus::core
