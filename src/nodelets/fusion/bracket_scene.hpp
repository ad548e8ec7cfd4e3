// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cv_bridge/cv_bridge.h>

#include <string>
#include <vector>

#include "all_in_focus/bracket_fusion.hpp"
#include "conversions.hpp"
#include "scene_cache.hpp"

namespace all_in_focus {

/// What the messages say of a scene, as the core takes it.
struct SharedScene {
  BracketScene scene;
  std::vector<std::string> remarks;  ///< what is missing or refused and what that means, a line each

  // The scene reads the messages' own memory.
  cv_bridge::CvImageConstPtr labels;
  DepthImage depth, measured;
};

/// The scene for a mode: paper takes the labels alone, and without labels nothing is taken. Depth or camera
/// that are missing or broken are left out. Throws on broken labels.
SharedScene toScene(const SceneMessages& messages, Mode mode);

}  // namespace all_in_focus
