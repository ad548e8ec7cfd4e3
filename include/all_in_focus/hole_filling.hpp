// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

namespace all_in_focus::core {

// All throw std::invalid_argument on another type or an empty image.

/// Maximum of the 3 x 3 neighbours inside the image (equation 4). depth, dilated: CV_16UC1 mm, 0 = unknown;
/// may be the same image. As printed in the paper, this also widens far surfaces by a pixel at the cost of
/// near ones.
void dilateDepth(const cv::Mat& depth, cv::Mat& dilated);

/// Fills holes by one step of anisotropic diffusion from two rows above (equations 5 to 8), in place and row
/// by row, so that rows below use what has just been filled. depth: CV_16UC1 mm; below 10 mm it is a hole.
/// The first three rows have no rows above them and stay as they are. Beyond the first and the last column
/// the gradient is 0. A hole stays one if the pixel two rows above is still a hole.
void fillByDiffusion(cv::Mat& depth);

/// Fills each hole across its narrow side (row or column, whichever run of unknown pixels is shorter) from
/// the farther of the two ends, because a shadow of the sensor falls on what lies behind the near object.
/// Where neither row nor column has two ends the sensor sees nothing at all, and depth stays unknown. depth,
/// filled: CV_16UC1 mm, 0 = unknown, fewer than 65535 rows and columns; not the same image.
void fillFromFarSide(const cv::Mat& depth, cv::Mat& filled);

}  // namespace all_in_focus::core
