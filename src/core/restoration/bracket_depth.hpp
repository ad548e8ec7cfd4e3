// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "optics/disc_blur.hpp"
#include "restoration/observed_bracket.hpp"

namespace all_in_focus::core {

/// Inverse depth that is looked for, 1/mm.
struct InverseDepthRange {
  float least = 0, largest = 0;
};

/// Depth from defocus: at every pixel the inverse depth at which the fused picture, blurred as the lens blurs
/// at that distance, explains the frames best; measured depth, where there is some, is preferred; neighbours
/// agree but where colours differ. Returns inverse depth, 1/mm, known everywhere.
cv::Mat1f depthFromBracket(const ObservedBracket& bracket, const BlurredPictures& pictures,
                           const InverseDepthRange& range);

}  // namespace all_in_focus::core
