// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

namespace all_in_focus {

/// What is wrong with a file; the message begins with its name.
struct FileError : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

[[noreturn]] inline void fail(const std::string& path, const std::string& what) {
  throw FileError(path + ": " + what);
}

}  // namespace all_in_focus
