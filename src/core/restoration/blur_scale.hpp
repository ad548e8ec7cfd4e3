// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "restoration/blurred_pictures.hpp"
#include "restoration/observed_bracket.hpp"

namespace all_in_focus::core {

/// How well the optics explain the bracket where depth was measured.
struct BlurScale {
  double scale = 0;     ///< measured radius / predicted one; 0: too little was measured
  double residual = 0;  ///< mean squared error, gray levels of a channel, of what is nearly sharp
};

/// Looks at measured pixels far from holes and jumps. Depth must be there.
BlurScale measureBlurScale(const ObservedBracket& bracket, const BlurredPictures& pictures);

/// Distance, px, of each pixel from the nearest hole or jump of the measured depth: CV_32FC1.
cv::Mat1f distanceFromDoubt(const ObservedBracket& bracket);

}  // namespace all_in_focus::core
