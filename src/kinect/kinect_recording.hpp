// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace all_in_focus {

/// Whether a device is the name of a file; everything else is an URI for the drivers.
bool isFileName(const std::string& device);

/// Throws std::runtime_error with one line for people when OpenNI2 cannot play the file, or would crash on
/// it: it is not there, cannot be read, is no recording, lacks its end, or is damaged before its first image.
/// What comes after is not looked at: it would take minutes with a long recording.
void requireRecording(const std::string& path);

}  // namespace all_in_focus
