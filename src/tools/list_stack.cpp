// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// Tells which pictures of a folder are frames and in which order, or how many a video has, for the programs
// in Python.

#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>

#include "command_line.hpp"
#include "file_error.hpp"
#include "stack_files.hpp"
#include "stack_reader.hpp"
#include "tiff_pages.hpp"

namespace fs = std::filesystem;
namespace po = boost::program_options;
using namespace all_in_focus;

namespace {

void list(const po::variables_map& values) {
  const std::string path = values["stack"].as<std::string>();
  StackFiles files;
  nlohmann::json paths, pages;  // of each frame; where the directory of its page begins, 0 = no TIFF
  int count = 0;
  if (holdsPictures(path) || (fs::is_regular_file(path) && isPictureName(path))) {
    files = listStack(path, {}, /*plain=*/true);
    count = static_cast<int>(files.frames.size());
  } else {
    count = StackReader(path).count();
    files.sources.push_back({path});
  }
  std::vector<TiffPage> found;
  for (const StackFiles::Source& source : files.sources) {
    if (source.page == 0) found = readTiffPages(source.path);
    paths.push_back(source.path);
    pages.push_back(found.empty() ? 0 : found[static_cast<std::size_t>(source.page)].at);
  }
  try {
    std::cout << nlohmann::json{{"frames", files.frames},
                                {"count", count},
                                {"paths", paths},
                                {"pages", pages},
                                {"left_out", files.left_out},
                                {"notes", files.notes}}
              << '\n';
  } catch (const nlohmann::json::type_error&) {
    fail(path, "a file or folder has a name that is not UTF-8: rename it");
  }
}

}  // namespace

int main(int argc, char** argv) {
  po::options_description options("Options");
  options.add_options()("stack", po::value<std::string>()->required(),
                        "folder of pictures, a TIFF of several pages, or a video");
  runTool(argc, argv, options,
          {"the frames of a stack in their order, of a video their number, as JSON", {"stack"}, {}, list});
}
