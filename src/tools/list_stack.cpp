// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Tells which pictures of a folder are frames and in which order, for the programs in Python.

#include <iostream>
#include <nlohmann/json.hpp>

#include "command_line.hpp"
#include "stack_files.hpp"
#include "tiff_pages.hpp"

namespace po = boost::program_options;
using namespace all_in_focus;

namespace {

void list(const po::variables_map& values) {
  const StackFiles files = listStack(values["stack"].as<std::string>(), {}, /*plain=*/true);
  nlohmann::json paths, pages;  // of each frame; where the directory of its page begins, 0 = no TIFF
  std::vector<TiffPage> found;
  for (const StackFiles::Source& source : files.sources) {
    if (source.page == 0) found = readTiffPages(source.path);
    paths.push_back(source.path);
    pages.push_back(found.empty() ? 0 : found[static_cast<std::size_t>(source.page)].at);
  }
  std::cout << nlohmann::json{{"frames", files.frames},
                              {"paths", paths},
                              {"pages", pages},
                              {"left_out", files.left_out},
                              {"notes", files.notes}}
            << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  po::options_description options("Options");
  options.add_options()("stack", po::value<std::string>()->required(),
                        "folder of pictures, or a TIFF of several pages");
  runTool(argc, argv, options, {"the frames of a stack folder in their order, as JSON", {"stack"}, {}, list});
}
