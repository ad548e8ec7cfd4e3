// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "restoration/image_formation.hpp"
#include "restoration/observed_bracket.hpp"

namespace all_in_focus::core {

/// The correction z of the fused picture x, gray levels, that makes it explain the frames I_k through their
/// image formation A_k:
///   sum omega_k (A_k (x + z) - I_k)^2 + z^2 / s^2 + 0.1 |grad z|^2 -> min,
/// beside jumps of inverse depth and where no frame is sharp, over the frames that are nearly sharp there. It
/// is removed where it explains nothing, and fades out elsewhere. CV_32FC3. Empty when proceed said stop.
std::optional<cv::Mat3f> correction(const ObservedBracket& bracket,
                                    const std::vector<ImageFormation>& formation,
                                    const cv::Mat1f& inverse_depth,
                                    const std::function<bool(double)>& proceed);

}  // namespace all_in_focus::core
