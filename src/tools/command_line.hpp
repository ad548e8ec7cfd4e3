// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <boost/program_options.hpp>
#include <exception>
#include <functional>
#include <string>
#include <vector>

#include "output_files.hpp"

namespace all_in_focus {

/// A program for files.
struct Tool {
  const char* purpose;
  std::vector<const char*> reads, writes;  ///< options that name files or folders
  std::function<void(const boost::program_options::variables_map&)> run;
  const char* positional = nullptr;  ///< the option that arguments without a name belong to
  bool separates = false;            ///< run() itself calls requireSeparate()
};

/// The paths that options of those names give; one may give several.
std::vector<NamedPath> given(const boost::program_options::variables_map& values,
                             const std::vector<const char*>& names);

/// Parses the command line, refuses outputs that would harm an input, see requireSeparate(), runs the tool
/// and turns errors into one line and exit code 2. --help prints `options`, --version that of the package.
/// Ends the process.
[[noreturn]] void runTool(int argc, char** argv, const boost::program_options::options_description& options,
                          const Tool& tool);

/// What an exception says is wrong, in a line.
std::string describe(const std::exception_ptr& error);

/// Value of a string option, "" if not given.
std::string textOption(const boost::program_options::variables_map& values, const char* name);

}  // namespace all_in_focus
