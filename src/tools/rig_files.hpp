// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "all_in_focus/camera.hpp"
#include "all_in_focus/optics.hpp"

namespace all_in_focus {

using namespace core;

/// Reads the rig of a folder: depth.yaml and color.yaml as camera_calibration writes them, extrinsics.yaml
/// with the pose of the depth camera in the colour camera's optical frame (translation in m, rotation as unit
/// quaternion x, y, z, w). Throws std::invalid_argument that names file and key.
Rig readRig(const std::string& folder);

/// Whether the rig folder tells the lens.
bool hasOptics(const std::string& folder);

/// Reads optics.yaml of the folder: focal_length_mm, aperture, circle_of_confusion_mm. Throws
/// std::invalid_argument that names file and key.
Optics readOptics(const std::string& folder);

/// Parses "f,F,coc", f and coc in mm. Throws std::invalid_argument.
Optics parseOptics(const std::string& text);

/// Reads focus distances in mm: `frames: [{file: 00.png, focus_mm: 855.0}, ...]`, .inf allowed. For a stack
/// folder they are found by file name (`stack/00.png` is the same file); for a video (names empty) they are
/// in frame order. Frames that are not listed are NaN = unknown. Entries for `left_out`, names of pictures
/// that are no frames, count for nothing. Or a focus table, as calibrate_focus writes it: then the distances
/// of the first `count` frames of a bracket. Throws std::invalid_argument that names the file.
std::vector<double> readFocus(const std::string& path, const std::vector<std::string>& names,
                              const std::vector<std::string>& left_out = {}, int count = 0);

}  // namespace all_in_focus
