// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Tells which pictures of a folder are frames and in which order, for the programs in Python.

#include <iostream>
#include <nlohmann/json.hpp>

#include "command_line.hpp"
#include "stack_files.hpp"

namespace po = boost::program_options;
using namespace all_in_focus;

int main(int argc, char** argv) {
  po::options_description options("Options");
  options.add_options()("stack", po::value<std::string>()->required(), "folder of pictures");
  const auto list = [](const po::variables_map& values) {
    const StackFiles files = listStack(values["stack"].as<std::string>(), {}, /*plain=*/true);
    std::cout << nlohmann::json{{"frames", files.frames},
                                {"left_out", files.left_out},
                                {"notes", files.notes}}
              << '\n';
  };
  runTool(argc, argv, options, {"the frames of a stack folder in their order, as JSON", {"stack"}, {}, list});
}
