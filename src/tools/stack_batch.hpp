// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <set>
#include <string>
#include <vector>

#include "stack_files.hpp"

namespace all_in_focus {

/// One focus bracket of several.
struct NamedStack {
  std::string path;             ///< folder, TIFF file or video
  std::string name;             ///< that its result gets, without ending; no two are alike
  std::set<std::string> files;  ///< names of the frames in it that belong to it; empty: all
};

/// The stacks that the paths name. A folder without frames that holds folders with pictures stands for these;
/// other paths are stacks. Throws FileError where a folder holds neither.
std::vector<NamedStack> findStacks(const std::vector<std::string>& paths);

/// Whether findStacks() finds anything but this path itself.
bool holdsStacks(const std::string& path);

/// Cuts a folder or a TIFF file that holds many brackets. rule: the number of frames of a bracket, or "gap":
/// a bracket ends where the time between two exposures is much longer than usual; without times, where the
/// next picture shows something else. Throws std::invalid_argument where the rule is neither, or there is no
/// gap.
std::vector<NamedStack> splitStack(const NamedStack& stack, const std::string& rule);

}  // namespace all_in_focus
