// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <boost/program_options.hpp>
#include <functional>
#include <string>

namespace all_in_focus {

/// Parses the command line, runs the tool and turns errors into one line and exit code 2. --help prints
/// `options`.
int runTool(int argc, char** argv, const char* purpose,
            const boost::program_options::options_description& options,
            const std::function<void(const boost::program_options::variables_map&)>& tool);

/// Value of a string option, "" if not given.
std::string textOption(const boost::program_options::variables_map& values, const char* name);

}  // namespace all_in_focus
