// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "alignment/similarity_transform.hpp"

namespace all_in_focus::core {

/// Brings a frame into the geometry of the reference: out(p) = frame(p'). What a frame does not show is
/// continued from its border.
///
/// A Lanczos kernel of six taps reads along the rows first and then across them. That takes a tenth of the
/// time of cv::warpAffine with its cubic kernel (16 bits: an eighth), and does not round positions to a 32nd
/// of a pixel. A frame that rolls goes through cv::warpAffine.
///
/// frame: CV_8UC3 or CV_16UC3. transform: from the reference to the frame.
cv::Mat warpedToReference(const cv::Mat& frame, const SimilarityTransform& transform,
                          const cv::Point2d& center);

}  // namespace all_in_focus::core
