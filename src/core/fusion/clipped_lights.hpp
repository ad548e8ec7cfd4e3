// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace all_in_focus::core {

/// Lamps, reflections and gaps in leaves, and what lies near them: a map of small white areas amid darker
/// ones. Such a light is clipped, so blur makes its disc larger but no fainter, and the coarse levels of a
/// sharpness measure grow with the blur.
///
/// gray: CV_8UC1, not empty. Lengths hold for a picture 640 px wide and grow with the width. A light is a
/// block of 2 x 2 px of at least 250 gray levels, if less than 15 % of the 26 x 26 px around it are as
/// bright. Near is within 12 px. Returns CV_8UC1 of half that size, 320 px wide: 255 near lights, else 0;
/// empty if there are no lights. Smaller pictures are not reduced.
cv::Mat clippedLights(const cv::Mat& gray);

/// The clipped lights that are brighter than white: in one of the frames a fifth more pixels around the light
/// are white than in the fused picture. gray: of that picture; frames: of the same size and type. Returns a
/// map as above.
cv::Mat lightsBeyondWhite(const cv::Mat& gray, const std::vector<cv::Mat>& frames);

}  // namespace all_in_focus::core
