// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace all_in_focus {

/// Whether a device is the name of a file. Everything else is a URI for the drivers.
bool isFileName(const std::string& device);

/// Throws std::runtime_error with a message of one line if OpenNI2 cannot play the file, or would crash on
/// it: it does not exist, cannot be read, is not a recording, is cut short, or is damaged before its first
/// image. The rest of the file is not checked: with a long recording that would take minutes.
void requireRecording(const std::string& path);

}  // namespace all_in_focus
