// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace all_in_focus {

/// While one exists, in any thread, only printToStderr() reaches stderr. It keeps out the codecs' warnings,
/// which would bury the tool's own line.
class QuietStderr {
 public:
  QuietStderr();
  ~QuietStderr();
  QuietStderr(const QuietStderr&) = delete;
  QuietStderr& operator=(const QuietStderr&) = delete;
};

/// Writes one line to stderr, also while another thread decodes an image. Control characters, which names of
/// files may hold, become blanks.
void printToStderr(std::string line);

/// Writes the text as it is to stderr, also while another thread decodes an image.
void writeToStderr(const std::string& text);

}  // namespace all_in_focus
