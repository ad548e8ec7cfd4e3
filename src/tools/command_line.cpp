// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "command_line.hpp"

#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <opencv2/core/utils/logger.hpp>
#include <stdexcept>

#include "quiet_stderr.hpp"

namespace po = boost::program_options;

namespace all_in_focus {
namespace {

// Freed memory stays with the process: the kernel clears every page that it hands out, which would take a
// tenth of restoration's time.
void keepFreedMemory() {
#ifdef __GLIBC__
  constexpr int kLargestMmapThreshold = 32 << 20;  // bytes; glibc admits no more
  mallopt(M_MMAP_THRESHOLD, kLargestMmapThreshold);
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
#endif
}

}  // namespace

int runTool(int argc, char** argv, const char* purpose, const po::options_description& options,
            const std::function<void(const po::variables_map&)>& tool) {
  keepFreedMemory();
  const std::string path = argv[0];
  const std::string name = path.substr(path.rfind('/') + 1);
  // The tool prints one line about what is wrong; the decoders' own messages would bury it.
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", /*overwrite=*/0);
  try {
    // An abbreviated option is an error, so that scripts do not break when options are added.
    const auto style = po::command_line_style::default_style & ~po::command_line_style::allow_guessing;
    po::variables_map values;
    po::positional_options_description none;
    po::store(po::command_line_parser(argc, argv).options(options).positional(none).style(style).run(),
              values);
    if (values.count("help")) {
      std::cout << name << ": " << purpose << "\n\n" << options;
      return 0;
    }
    po::notify(values);
    for (const auto& [option, value] : values) {
      const auto* text = boost::any_cast<std::string>(&value.value());
      const bool is_flag = options.find(option, /*approx=*/false).semantic()->max_tokens() == 0;
      if (text && text->empty() && !is_flag) throw std::invalid_argument("--" + option + " is empty");
    }
    tool(values);
    return 0;
  } catch (const std::exception& e) {
    std::string line = e.what();
    std::replace(line.begin(), line.end(), '\n', ' ');
    printToStderr(std::string(name) + ": " + line);
    return 2;
  }
}

std::string textOption(const po::variables_map& values, const char* name) {
  return values.count(name) ? values[name].as<std::string>() : std::string();
}

}  // namespace all_in_focus
