// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

namespace all_in_focus::core {

/// Gives each pixel of the image that is not known the value of the nearest one that is. known: CV_8UC1, not
/// 0 at one pixel at least.
void continueFromNearest(const cv::Mat& known, cv::Mat& image);

/// The colours of a frame, and where it shows nothing: where alpha is 0, or, without alpha, in rows and
/// columns at its border that are black from end to end beside a picture that is not, as programs that align
/// frames leave them.
///
/// frame: CV_8U or CV_16U, three or four channels. opaque: CV_8UC1, 0 where it shows nothing, else 255; empty
/// where it shows something everywhere. There, colours are continued from the nearest pixel that shows
/// something, so that no contour is seen.
cv::Mat contentOf(const cv::Mat& frame, cv::Mat& opaque);

}  // namespace all_in_focus::core
