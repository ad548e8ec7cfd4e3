// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "all_in_focus/bracket.hpp"
#include "conversions.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {

/// What is known of the lens that the colour camera was calibrated with.
struct CalibrationLens {
  double pixel_pitch_mm = 0;  ///< of the camera at its calibrated size, 0 = unknown
  OpticsConstPtr optics;      ///< of the rig; null: unknown
};

/// The scene of the messages in the types of the core, and what is missing or refused, with its effect, one
/// line each.
struct SharedScene {
  BracketScene scene;  ///< may read the messages' own memory
  std::vector<std::string> warnings;
  SceneMessages messages;
};

/// The scene for a mode. Mode paper uses labels, the other modes depth, lens and camera; the report lists the
/// regions of labels, and depth is published, in all modes. What is missing or broken is left out. frame:
/// size of the first frame.
SharedScene toScene(const SceneMessages& messages, Mode mode, const cv::Size& frame,
                    const CalibrationLens& calibration);

/// Adds labels and depth that were not there before, for the report and for the outputs, and the newest
/// camera. Returns whether there are labels now that were not there before.
bool joinLate(const SceneMessages& now, SharedScene& shared);

}  // namespace all_in_focus
